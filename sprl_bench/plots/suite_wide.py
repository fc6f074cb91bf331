"""Whole suites: performance profiles, and the probability that one agent improves on the others.

The numbers are those of the report and of `sprl_bench.tables.aggregates`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Final

from sprl_bench import scores
from sprl_bench.plots.sheet import check_width, lay_out
from sprl_bench.plots.style import Look, check_suffix, draw_caption, draw_grid, draw_legend, looks_of, save
from sprl_bench.records import RunRecord, RunSpec
from sprl_bench.suggestions import unknown
from sprl_bench.tables import Result, tabulate, tabulate_results
from sprl_bench.tables.aggregates import Improvement, improvement_of, matrices_of, profile_of
from sprl_bench.tables.render import marked

if TYPE_CHECKING:  # the extra `plots`
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Matrices = Mapping[str, Mapping[str, scores.Array]]
"""AUCs [S, T] as shares of the score range, by suite and agent."""
Labels = Mapping[str, str]
"""What pictures call an agent, where that is not its name alone."""
NO_LABELS: Final[Labels] = MappingProxyType({})
ROW = 0.22  # inches, of an agent


def suite_matrices(
    records: Iterable[RunRecord],
    *,
    tasks: Sequence[str] | None = None,
    agents: Sequence[str] | None = None,
    planned: Iterable[RunSpec] = (),
    allow_missing: bool = False,
) -> Matrices:
    """Return the scores that the pictures of this file show; arguments and errors are those of `tabulate`.

    An agent is there if it has a seed on every task of the suite.
    """
    everything = list(records)
    tables = tabulate(everything, tasks=tasks, agents=agents, planned=planned, allow_missing=allow_missing)
    results = [Result.of(record) for record in everything if record.status == "complete"]
    return {
        table.suite: matrices_of([result for result in results if result.suite == table.suite], table)
        for table in tables
    }


def board_matrices(
    results: Sequence[Result],
    *,
    tasks: Sequence[str] | None = None,
    planned: Iterable[RunSpec] = (),
    allow_missing: bool = False,
) -> Matrices:
    """Return the same for the results of one suite, such as a board's entries; else as `suite_matrices`."""
    table = tabulate_results(results, tasks=tasks, planned=planned, allow_missing=allow_missing)
    return {table.suite: matrices_of(results, table)}


def suite_labels(runs: Iterable[RunSpec | Result]) -> Labels:
    """Return each agent's name with its marks, such as "gt-grid †" for a privileged one."""
    return {run.agent: marked(run.agent, run.privileged, run.information) for run in runs}


def plot_suites(
    matrices: Matrices, output: Path, kind: str, *, width: str | None = None, labels: Labels = NO_LABELS
) -> None:
    """Draw one panel a suite into a .png, .svg or .pdf file.

    Args:
        matrices: See `suite_matrices`.
        output: The file.
        kind: One of `KINDS`.
        width: One of `WIDTHS`; None for one that the panels need.
        labels: See `suite_labels`.

    Raises:
        ValueError: The kind, the width or the suffix is not allowed, or there are too few agents.
    """
    check_suffix(output)
    check_width(width)
    if kind not in KINDS:
        raise ValueError(unknown("kind", kind, KINDS))
    least = min(map(len, matrices.values()), default=0)
    if least < LEAST[kind]:
        raise ValueError(f"kind is {kind!r}; it must be of {LEAST[kind]} or more agents with runs of every task.")
    save(lambda: KINDS[kind](matrices, width=width, labels=labels), output, width=width)


def draw_profiles(matrices: Matrices, *, width: str | None = None, labels: Labels = NO_LABELS) -> Figure:
    """Return a figure of the share of runs that score more than each threshold; the higher, the better."""
    from matplotlib.figure import Figure  # noqa: PLC0415 - the extra `plots`, and slow to load

    looks = _looks(matrices)
    names = [labels.get(agent, agent) for agent in looks]
    sheet = lay_out((len(matrices), len(matrices)), names, names, width)
    figure = Figure(figsize=sheet.size, layout="constrained")
    for axes, (suite, agents) in zip(_panels(figure, sheet.rows, sheet.columns), matrices.items(), strict=False):
        for agent, matrix in agents.items():
            axes.plot(*profile_of(matrix), color=looks[agent].colour, linestyle=looks[agent].dashes, linewidth=1.6)
        axes.set(title=suite, xlabel="AUC, share of the score range", xlim=(0, 1), ylim=(-0.02, 1.02))
        draw_grid(axes)
    figure.axes[0].set_ylabel("Share of runs above")
    draw_caption(figure, f"Share of all runs, each task with the same weight.{_marks(names)}")
    draw_legend(figure, list(looks.values()), sheet.names, sheet.abreast)
    return figure


def draw_improvement(matrices: Matrices, *, width: str | None = None, labels: Labels = NO_LABELS) -> Figure:
    """Return a figure of how probably a run of each agent scores higher than a run of the best one."""
    from matplotlib.figure import Figure  # noqa: PLC0415 - the extra `plots`, and slow to load

    looks = _looks(matrices)
    names = [labels.get(agent, agent) for agent in looks]
    sheet = lay_out((len(matrices), len(matrices)), names, names, width)
    height = sheet.rows * (ROW * max(map(len, matrices.values())) + 0.8) + 0.2
    figure = Figure(figsize=(sheet.size[0], height), layout="constrained")
    for axes, (suite, agents) in zip(_panels(figure, sheet.rows, sheet.columns), matrices.items(), strict=False):
        best = max(agents, key=lambda agent: float(scores.mean(agents[agent])))
        _draw_improvements(
            axes, [improvement_of(other, best, agents) for other in agents if other != best], looks, labels
        )
        axes.set(title=suite, xlabel=f"P(agent > {labels.get(best, best)})", xlim=(-0.02, 1.02))
    draw_caption(figure, f"Probability of improvement with 95 % bootstrap intervals.{_marks(names)}")
    return figure


def _marks(names: Sequence[str]) -> str:
    return " † privileged." * any("†" in name for name in names)


def _looks(matrices: Matrices) -> dict[str, Look]:
    return looks_of(agent for agents in matrices.values() for agent in agents)


def _panels(figure: Figure, rows: int, columns: int) -> Sequence[Axes]:
    """Return the panels of a figure."""
    return list(figure.subplots(rows, columns, squeeze=False).flat)


def _draw_improvements(axes: Axes, found: Sequence[Improvement], looks: Mapping[str, Look], labels: Labels) -> None:
    """Draw a point with its interval for each agent, the best at the top."""
    ordered = sorted(found, key=lambda one: (one.value, one.agent))
    for place, one in enumerate(ordered):
        colour = looks[one.agent].colour
        axes.plot([one.value], [place], "o", color=colour, markersize=4)
        if one.interval is not None:
            axes.hlines(place, *one.interval, color=colour, linewidth=1.6)
    axes.axvline(0.5, color="#555555", linewidth=0.8, linestyle="--")
    axes.set_yticks(range(len(ordered)), [labels.get(one.agent, one.agent) for one in ordered])
    axes.set_ylim(-0.6, len(ordered) - 0.4)
    draw_grid(axes)


KINDS: Final[Mapping[str, Callable[..., Figure]]] = MappingProxyType(
    {"profiles": draw_profiles, "improvement": draw_improvement}
)
LEAST: Final = MappingProxyType({"profiles": 1, "improvement": 2})
"""How many agents a picture needs."""
