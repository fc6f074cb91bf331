"""Learning curves: one panel a task, one line an agent, the mean over seeds and its 95 % bootstrap band.

A thin line for each run shows what a mean hides: two of five seeds that learn, say.
"""

from __future__ import annotations

import textwrap
from collections.abc import Collection, Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from sprl_bench import scores
from sprl_bench.plots.sheet import check_width, lay_out
from sprl_bench.plots.style import (
    COLUMNS,
    Look,
    check_suffix,
    draw_caption,
    draw_grid,
    draw_legend,
    draw_runs,
    looks_of,
    save,
    short_number,
)
from sprl_bench.records import RunRecord, RunSpec
from sprl_bench.suggestions import unknown
from sprl_bench.tables import BOOTSTRAP_SEED, MissingRunsError, Result, Table, tabulate, tabulate_results, task_names
from sprl_bench.tables.render import marked
from sprl_bench.tables.table import Row

if TYPE_CHECKING:  # the extra `plots`
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def plot(
    records: Iterable[RunRecord],
    output: str | Path,
    *,
    tasks: Sequence[str] | None = None,
    agents: Sequence[str] | None = None,
    planned: Iterable[RunSpec] = (),
    allow_missing: bool = False,
    width: str | None = None,
) -> None:
    """Draw the learning curves of these records into a file; the same records give the same bytes.

    The arguments and errors are those of `sprl_bench.tables.tabulate`; `output` is a .png, .svg or .pdf file,
    and `width` one of `WIDTHS`, or None for one that the panels need.
    """
    output = Path(output)
    check_suffix(output)
    check_width(width)
    everything = list(records)
    tables = tabulate(everything, tasks=tasks, agents=agents, planned=planned, allow_missing=allow_missing)
    results = [Result.of(record) for record in everything if record.status == "complete"]
    save(lambda: draw_curves(tables, results, width=width), output, width=width)


def plot_results(
    results: Sequence[Result],
    output: Path,
    *,
    tasks: Sequence[str] | None = None,
    planned: Iterable[RunSpec] = (),
    allow_missing: bool = False,
    width: str | None = None,
) -> None:
    """Draw the learning curves of one suite's results, such as a board's entries; else as `plot`."""
    check_suffix(output)
    check_width(width)
    if not results:
        raise MissingRunsError("There is no finished run to draw.")
    names = task_names(results)
    for task in tasks or ():
        if task not in names:
            raise ValueError(unknown("task among these results:", task, names))
    table = tabulate_results(results, tasks=tasks, planned=planned, allow_missing=allow_missing)
    save(lambda: draw_curves([table], results, width=width), output, width=width)


def draw_curves(tables: Sequence[Table], results: Collection[Result], *, width: str | None = None) -> Figure:
    """Return a figure with one panel for each task of each table.

    Args:
        tables: The suites, tasks and agents to draw.
        results: Their runs, and maybe others.
        width: One of `WIDTHS`; None for one that the panels need.
    """
    from matplotlib.figure import Figure  # noqa: PLC0415 - the extra `plots`, and slow to load

    panels = [(table, task) for table in tables for task in table.tasks]
    looks = looks_of(row.agent for table in tables for row in table.rows)
    names = [f"{agent} {_describe(agent, tables)}" for agent in looks]
    sheet = lay_out((len(panels), COLUMNS), names, [_short_name(agent, tables) for agent in looks], width)
    figure = Figure(figsize=sheet.size, layout="constrained")
    grid = figure.subplots(sheet.rows, sheet.columns, squeeze=False)
    for (table, task), axes in zip(panels, grid.flat, strict=False):
        axes.set_title(textwrap.fill(task if len(tables) == 1 else f"{table.suite}: {task}", sheet.letters))
        agents = {row.agent for row in table.rows}
        runs = [run for run in results if (run.suite, run.task.name) == (table.suite, task) and run.agent in agents]
        _draw_panel(axes, runs, looks)
    for axes in grid.flat[len(panels) :]:
        axes.set_visible(False)
    for axes in grid[:, 0]:
        axes.set_ylabel("Mean return")
    draw_caption(figure, _caption(tables, is_short=sheet.names is not names))
    draw_legend(figure, list(looks.values()), sheet.names, sheet.abreast)
    return figure


def _caption(tables: Sequence[Table], *, is_short: bool) -> str:
    """Say what is drawn, and what a legend of short names leaves out."""
    rows = [row for table in tables for row in table.rows]
    seeds = f"{_seeds(rows)} " if is_short else ""
    marks = " † privileged." if is_short and any(row.privileged for row in rows) else ""
    return f"Mean over {seeds}seeds; bands are 95 % bootstrap intervals, thin lines single runs.{marks}"


def _draw_panel(axes: Axes, runs: Sequence[Result], looks: Mapping[str, Look]) -> None:
    """Draw all agents' runs of one task."""
    for agent in sorted({run.agent for run in runs}):
        curves = np.asarray([run.return_curve for run in runs if run.agent == agent])
        _draw_agent(axes, curves, runs[0].task.budget, looks[agent])
    if runs:
        low, high = _range(runs)
        axes.set_ylim(low - 0.02 * (high - low), high + 0.02 * (high - low))
        axes.set_xlim(0, runs[0].task.budget)
    axes.xaxis.set_major_formatter(short_number)
    axes.set_xlabel("Environment steps")
    draw_grid(axes)


def _range(runs: Sequence[Result]) -> tuple[float, float]:
    """Return the range of one task's scores, widened to the returns: in a task of no suite they may leave it.

    A range that reaches far beyond all returns, such as that of an Atari game, is cut to these.
    """
    reached = [value for run in runs for value in (min(run.return_curve), max(run.return_curve))]
    ends = [value for run in runs for value in run.task.score_range]
    if max(ends) > 1 and 0 < max(reached) < max(ends) / 10:
        return min(*ends, *reached), max(reached)
    return min(*ends, *reached), max(*ends, *reached)


def _draw_agent(axes: Axes, curves: scores.Array, budget: int, look: Look) -> None:
    """Draw the mean of curves [S, 100], each bin at its end, and each curve on its own as a thin line."""
    steps = budget * np.arange(1, scores.BINS + 1) / scores.BINS
    draw_runs(axes, [(steps, curve) for curve in curves], look)
    axes.plot(steps, curves.mean(axis=0), color=look.colour, linestyle=look.dashes, linewidth=1.6)
    band = scores.curve_band(curves, np.random.default_rng(BOOTSTRAP_SEED))
    if band is not None:
        axes.fill_between(steps, *band, color=look.colour, alpha=0.12, linewidth=0)


def _describe(agent: str, tables: Sequence[Table]) -> str:
    """Return "(5 seeds)", a range if tasks differ, with a dagger for a privileged agent."""
    rows = _rows(agent, tables)
    number = _seeds(rows)
    mark = "† privileged, " if any(row.privileged for row in rows) else ""
    mark += "".join(f"{word}, " for word in sorted({word for row in rows for word in row.information}))
    return f"({mark}{number} seed{'' if number == '1' else 's'})"


def _short_name(agent: str, tables: Sequence[Table]) -> str:
    """Return an agent's name with its marks alone."""
    rows = _rows(agent, tables)
    return marked(
        agent, any(row.privileged for row in rows), sorted({word for row in rows for word in row.information})
    )


def _rows(agent: str, tables: Sequence[Table]) -> list[Row]:
    return [row for table in tables for row in table.rows if row.agent == agent]


def _seeds(rows: Sequence[Row]) -> str:
    """Return how many seeds there are, a range if tasks differ."""
    counts = sorted({len(cell.seeds) for row in rows for cell in row.cells})
    return str(counts[0]) if len(counts) == 1 else f"{counts[0]} to {counts[-1]}"
