"""Learning curves: one panel a task, one line an agent, the mean over seeds and its 95 % bootstrap band.

Drawn without a display. The colours are those of Okabe and Ito, safe for colour-blind readers; when they are used up,
dashes follow. matplotlib is loaded when something is drawn.
"""

from __future__ import annotations

import io
import textwrap
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Literal

import numpy as np

from sprl_bench import scores
from sprl_bench.records import RunRecord, RunSpec, write_bytes
from sprl_bench.suggestions import unknown
from sprl_bench.tables import BOOTSTRAP_SEED, MissingRunsError, Result, Table, tabulate, tabulate_results, task_names

if TYPE_CHECKING:  # the extra `plots`
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SUFFIXES = (".pdf", ".png", ".svg")
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
Dashes = Literal["-", "--", ":", "-."]
DASHES: Final[tuple[Dashes, ...]] = ("-", "--", ":", "-.")
COLUMNS = 4
PANEL = (3.4, 2.7)  # inches
TITLE_LETTERS = 44  # of a line above a panel
SAMPLE = 0.7  # inches, of the line before a name in the legend and the space around both
LEGEND_ROW = 0.19  # inches
UNDATED: Mapping[str, Mapping[str, None]] = {".pdf": {"CreationDate": None}, ".svg": {"Date": None}, ".png": {}}
STYLE: Final[Any] = {  # matplotlib keeps the type of the keys to itself
    "axes.spines.right": False,
    "axes.spines.top": False,
    "axes.titlesize": 10,
    "font.size": 9,
    "legend.frameon": False,
    "svg.fonttype": "none",
    "svg.hashsalt": "sprl-bench",
    "text.parse_math": False,  # a name is a name
}


@dataclass(frozen=True)
class Look:
    """How an agent is drawn, in every panel."""

    colour: str
    dashes: Dashes


def plot(
    records: Iterable[RunRecord],
    output: Path,
    *,
    tasks: Sequence[str] | None = None,
    agents: Sequence[str] | None = None,
    planned: Iterable[RunSpec] = (),
    allow_missing: bool = False,
) -> None:
    """Draw the learning curves of these records into a file; the same records give the same bytes.

    The arguments and errors are those of `sprl_bench.tables.tabulate`; `output` is a .png, .svg or .pdf file.
    """
    _check_suffix(output)
    everything = list(records)
    tables = tabulate(everything, tasks=tasks, agents=agents, planned=planned, allow_missing=allow_missing)
    _write(tables, [Result.of(record) for record in everything if record.status == "complete"], output)


def plot_results(
    results: Sequence[Result],
    output: Path,
    *,
    tasks: Sequence[str] | None = None,
    planned: Iterable[RunSpec] = (),
    allow_missing: bool = False,
) -> None:
    """Draw the learning curves of one suite's results, such as a board's entries; else as `plot`."""
    _check_suffix(output)
    if not results:
        raise MissingRunsError("There is no finished run to draw.")
    names = task_names(results)
    for task in tasks or ():
        if task not in names:
            raise ValueError(unknown("task among these results:", task, names))
    _write([tabulate_results(results, tasks=tasks, planned=planned, allow_missing=allow_missing)], results, output)


def _check_suffix(output: Path) -> None:
    if output.suffix.lower() not in SUFFIXES:
        raise ValueError(unknown("suffix of a picture:", output.suffix, SUFFIXES))


def _write(tables: Sequence[Table], results: Collection[Result], output: Path) -> None:
    """Write the figure of `draw_curves` to a file."""
    import matplotlib as mpl  # noqa: PLC0415 - the extra `plots`, and slow to load

    suffix = output.suffix.lower()

    with mpl.rc_context(STYLE):
        buffer = io.BytesIO()
        figure = draw_curves(tables, results)
        figure.savefig(buffer, format=suffix[1:], dpi=200, metadata=dict(UNDATED[suffix]))
    write_bytes(output, buffer.getvalue())


def draw_curves(tables: Sequence[Table], results: Collection[Result]) -> Figure:
    """Return a figure with one panel for each task of each table.

    Args:
        tables: The suites, tasks and agents to draw.
        results: Their runs, and maybe others.
    """
    from matplotlib.figure import Figure  # noqa: PLC0415 - the extra `plots`, and slow to load

    panels = [(table, task) for table in tables for task in table.tasks]
    columns = min(COLUMNS, len(panels))
    rows = -(-len(panels) // columns)
    looks = _looks(row.agent for table in tables for row in table.rows)
    names = [f"{agent} {_describe(agent, tables)}" for agent in looks]
    longest = max(map(_inches, names)) + SAMPLE
    width = max(columns * PANEL[0], longest)
    abreast = int(width / longest)
    height = rows * PANEL[1] + LEGEND_ROW * -(-len(names) // abreast) + 0.2
    figure = Figure(figsize=(width, height), layout="constrained")
    grid = figure.subplots(rows, columns, squeeze=False)
    for (table, task), axes in zip(panels, grid.flat, strict=False):
        axes.set_title(textwrap.fill(task if len(tables) == 1 else f"{table.suite}: {task}", TITLE_LETTERS))
        agents = {row.agent for row in table.rows}
        runs = [run for run in results if (run.suite, run.task.name) == (table.suite, task) and run.agent in agents]
        _draw_panel(axes, runs, looks)
    for axes in grid.flat[len(panels) :]:
        axes.set_visible(False)
    for axes in grid[:, 0]:
        axes.set_ylabel("Mean return")
    figure.supxlabel("Mean over seeds; bands are 95 % bootstrap intervals.", fontsize=7, color="#555555")
    _draw_legend(figure, list(looks.values()), names, abreast)
    return figure


def _looks(agents: Iterable[str]) -> dict[str, Look]:
    """Return each agent's look; its presets and variants, as sprl@tuned+k=3, have its colour and other dashes."""
    looks: dict[str, Look] = {}
    families: dict[str, str] = {}
    for agent in sorted(set(agents), key=lambda name: (_family(name) != name, name)):
        family = _family(agent)
        colour = families.setdefault(family, COLOURS[len(families) % len(COLOURS)])
        wanted = [Look(colour, dashes) for dashes in DASHES]
        others = [Look(other, dashes) for dashes in DASHES for other in COLOURS]
        looks[agent] = next((look for look in (*wanted, *others) if look not in looks.values()), wanted[0])
    return dict(sorted(looks.items()))


def _family(agent: str) -> str:
    return agent.partition("+")[0].partition("@")[0]


def _draw_panel(axes: Axes, runs: Sequence[Result], looks: Mapping[str, Look]) -> None:
    """Draw all agents' runs of one task."""
    for agent in sorted({run.agent for run in runs}):
        curves = np.asarray([run.return_curve for run in runs if run.agent == agent])
        _draw_agent(axes, curves, runs[0].task.budget, looks[agent])
    if runs:
        low, high = _range(runs)
        axes.set_ylim(low - 0.02 * (high - low), high + 0.02 * (high - low))
        axes.set_xlim(0, runs[0].task.budget)
    axes.xaxis.set_major_formatter(_short_number)
    axes.set_xlabel("Environment steps")
    axes.grid(visible=True, color="#e6e6e6", linewidth=0.6)
    axes.set_axisbelow(True)


def _range(runs: Sequence[Result]) -> tuple[float, float]:
    """Return the range of one task's scores, widened to the returns: in a task of no suite they may leave it."""
    values = [value for run in runs for value in (*run.task.score_range, min(run.return_curve), max(run.return_curve))]
    return min(values), max(values)


def _draw_agent(axes: Axes, curves: scores.Array, budget: int, look: Look) -> None:
    """Draw the mean of curves [S, 100], each bin at its end."""
    steps = budget * np.arange(1, scores.BINS + 1) / scores.BINS
    axes.plot(steps, curves.mean(axis=0), color=look.colour, linestyle=look.dashes, linewidth=1.6)
    band = scores.curve_band(curves, np.random.default_rng(BOOTSTRAP_SEED))
    if band is not None:
        axes.fill_between(steps, *band, color=look.colour, alpha=0.12, linewidth=0)


def _inches(text: str) -> float:
    """Return the width of a text in the legend."""
    from matplotlib import rcParams  # noqa: PLC0415 - the extra `plots`, and slow to load
    from matplotlib.textpath import TextPath  # noqa: PLC0415 - likewise

    points = float(TextPath((0, 0), text, size=rcParams["font.size"]).get_extents().width)
    return 1.05 * points / 72  # letters are drawn on whole pixels, a little wider than their outlines


def _draw_legend(figure: Figure, looks: Sequence[Look], names: Sequence[str], columns: int) -> None:
    """Name each agent once, above all panels."""
    from matplotlib.lines import Line2D  # noqa: PLC0415 - the extra `plots`, and slow to load

    lines = [Line2D([], [], color=look.colour, linestyle=look.dashes, linewidth=1.6) for look in looks]
    figure.legend(lines, names, loc="outside upper center", ncols=min(columns, len(names)))


def _describe(agent: str, tables: Sequence[Table]) -> str:
    """Return "(5 seeds)", a range if tasks differ, with a dagger for a privileged agent."""
    rows = [row for table in tables for row in table.rows if row.agent == agent]
    counts = sorted({len(cell.seeds) for row in rows for cell in row.cells})
    number = str(counts[0]) if len(counts) == 1 else f"{counts[0]} to {counts[-1]}"
    mark = "† privileged, " if any(row.privileged for row in rows) else ""
    return f"({mark}{number} seed{'' if counts == [1] else 's'})"


def _short_number(value: float, _position: float) -> str:
    """Return 500k for 500,000 and 2M for 2,000,000."""
    for size, letter in ((1e6, "M"), (1e3, "k")):
        if abs(value) >= size:
            return f"{value / size:g}{letter}"
    return f"{value:g}"
