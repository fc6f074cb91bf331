"""A table in five formats: for a terminal, a page, a spreadsheet, a paper and a program.

Each shows which agents are privileged, how many seeds there are, and which runs are missing.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace

from sprl_bench.suggestions import unknown
from sprl_bench.tables.drops import drops_line
from sprl_bench.tables.leaders import BOLD, leaders_of
from sprl_bench.tables.table import MEASURES, Cell, Estimate, Row, Table
from sprl_bench.tables.text_table import DIGITS, GRID_FORMATS, Grid, as_json, draw, number

FORMATS = (*GRID_FORMATS, "csv", "json")

PRIVILEGED = "† privileged: sees what an ordinary agent does not."
PARTIAL = "‡ runs are missing; its overall figures are over the seeds that it has on every task."
SCORES = "Intervals: 95 %, stratified bootstrap over seeds. Final and success: over the last tenth of the budget."
INFORMATION = {
    "relabelling": "(relabelling): asks for the reward of goals that it did not pursue.",
    "resetting": "(resetting): returns the simulator to earlier states.",
    "shaped": "(shaped): learns from another reward than the task's; its score is the task's.",
}
CSV_COLUMNS = ("suite", "suite_version", "agent", "privileged", "task", "measure", "value", "low", "high", "seeds")
DASH = "-"
BLOCKS = "▁▂▃▄▅▆▇█"
TRENDS = "Blocks: the mean learning curve, one for each eighth of the budget, over the task's score range."


def render(
    tables: Sequence[Table], form: str = "md", *, width: int | None = None, columns: Sequence[str] | None = None
) -> str:
    """Return tables as text that ends in a newline.

    Args:
        tables: One a suite.
        form: One of `FORMATS`.
        width: Columns of the terminal for "rich"; None for plain text of any width.
        columns: Beside the agent, in this order: tasks, or "Seeds", "Mean AUC", "IQM", "Final", "Success"; None for
            all. CSV and JSON always hold all.

    Raises:
        ValueError: There is no such format, or no such column.
    """
    if form not in FORMATS:
        raise ValueError(unknown("format", form, FORMATS))
    if form == "json":
        return as_json(tables)
    if form == "csv":
        return _csv(tables)
    grids = [_grid(table, trends=form == "rich") for table in tables]
    if form == "latex":
        grids = [_with_leaders(grid, table) for grid, table in zip(grids, tables, strict=True)]
    return draw([_narrowed(grid, columns) for grid in grids], form, width=width)


def _with_leaders(grid: Grid, table: Table) -> Grid:
    """Return a grid that knows its best numbers, which begin after agent and seeds."""
    leaders = {(row, place + 2) for row, place in leaders_of(table)}
    return replace(grid, leaders=leaders, footnotes=[*grid.footnotes, BOLD])


def _narrowed(grid: Grid, columns: Sequence[str] | None) -> Grid:
    """Return the agents and these columns."""
    if columns is None:
        return grid
    places = {name.lower(): place for place, name in enumerate(grid.header) if place}
    for name in columns:
        if name.lower() not in places:
            raise ValueError(unknown("column", name, grid.header[1:]))
    return grid.only([0, *(places[name.lower()] for name in columns)])


def _grid(table: Table, *, trends: bool) -> Grid:
    return Grid(
        title=f"Suite {table.suite}, version {table.suite_version}",
        header=["Agent", "Seeds", *table.tasks, "Mean AUC", "IQM", "Final", "Success"],
        rows=[_texts(row, trends=trends) for row in table.rows],
        footnotes=[*([TRENDS] if trends else []), *footnotes(table)],
    )


def _texts(row: Row, *, trends: bool) -> list[str]:
    name = marked(row.agent, row.privileged, row.information) + " ‡" * (not row.complete)
    overall = map(_with_interval, (row.auc, row.auc_iqm, row.final, row.success_final))
    return [name, str(len(row.seeds)), *(_cell(cell, trends=trends) for cell in row.cells), *overall]


def marked(agent: str, privileged: bool, information: Sequence[str] = ()) -> str:
    """Return an agent's name with its marks, such as "gt-grid †" or "her-sac (relabelling)"."""
    return agent + " †" * privileged + (f" ({', '.join(information)})" if information else "")


def explained(marks: Iterable[tuple[bool, Sequence[str]]]) -> list[str]:
    """Return a sentence for each mark that an agent has, from whether each is privileged and what else it uses."""
    there = list(marks)
    words = sorted({word for _, information in there for word in information})
    return [
        *([PRIVILEGED] if any(privileged for privileged, _ in there) else []),
        *(INFORMATION[word] for word in words),
    ]


def _cell(cell: Cell, *, trends: bool) -> str:
    there = f"\n{len(cell.seeds)} of {len(cell.seeds) + len(cell.missing)}" if cell.missing else ""
    trend = f"\n{sparkline(cell.trend)}" if trends and cell.trend else ""
    return _with_interval(cell.auc) + there + trend


def sparkline(shares: Sequence[float]) -> str:
    """Return a curve as blocks, one a value: the lowest at 0 and below, the highest at 1 and above."""
    return "".join(BLOCKS[round(min(max(share, 0.0), 1.0) * (len(BLOCKS) - 1))] for share in shares)


def _with_interval(value: Estimate | None) -> str:
    return DASH if value is None else f"{number(value.value)}\n{interval_text(value.interval)}"


def interval_text(interval: tuple[float, float] | None) -> str:
    """Return "[low, high]", or a dash for a single seed."""
    return DASH if interval is None else f"[{number(interval[0])}, {number(interval[1])}]"


def footnotes(table: Table) -> list[str]:
    """Return all sentences below a table: what its marks and numbers mean, and its notes."""
    return [
        SCORES,
        *explained((row.privileged, row.information) for row in table.rows),
        *([PARTIAL] if not all(row.complete for row in table.rows) else []),
        *table.notes,
        drops_line(table.planned, table.drops, table.unreadable),
    ]


def _csv(tables: Sequence[Table]) -> str:
    """Return one line a number; the task "all" is the whole suite."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([*CSV_COLUMNS, "missing", "information"])
    for table in tables:
        for row in table.rows:
            for line in _csv_lines(row):
                named = table.suite, table.suite_version, row.agent, str(row.privileged).lower()
                writer.writerow([*named, *line, " ".join(row.information)])
    return text.getvalue()


def _csv_lines(row: Row) -> Iterator[list[object]]:
    for cell in row.cells:
        for name in MEASURES:
            yield [cell.task, name, *_numbers(getattr(cell, name)), len(cell.missing)]
    missing = sum(len(cell.missing) for cell in row.cells)
    for name in (*MEASURES, "auc_iqm"):
        yield ["all", name, *_numbers(getattr(row, name)), missing]


def _numbers(value: Estimate | None) -> list[object]:
    if value is None:
        return ["", "", "", 0]
    low, high = (f"{end:.{DIGITS}f}" for end in value.interval) if value.interval else ("", "")
    return [f"{value.value:.{DIGITS}f}", low, high, value.seeds]
