"""A table of one statistic as text, in the formats of an ordinary table."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from typing import Final

from sprl_bench.suggestions import unknown
from sprl_bench.tables.drops import drops_line
from sprl_bench.tables.render import DASH, FORMATS, explained, marked
from sprl_bench.tables.statistics import EXPLAINED, StatisticCell, StatisticTable
from sprl_bench.tables.text_table import DIGITS, Grid, as_json, draw, number

TITLES: Final = {
    "first-goal": "Env steps to the first goal",
    "oracle": "Oracle-normalised AUC",
    "solved": "Share of solved seeds",
}
CSV_COLUMNS: Final = ("suite", "agent", "privileged", "task", "statistic", "value", "low", "high", "count", "seeds")


def render_statistic(tables: Sequence[StatisticTable], form: str = "md", *, width: int | None = None) -> str:
    """Return tables as text that ends in a newline; the arguments and the error are those of `render`."""
    if form not in FORMATS:
        raise ValueError(unknown("format", form, FORMATS))
    if form == "json":
        return as_json(tables)
    if form == "csv":
        return _csv(tables)
    return draw([_grid(table) for table in tables], form, width=width)


def _grid(table: StatisticTable) -> Grid:
    return Grid(
        title=f"{TITLES[table.statistic]}: suite {table.suite}, version {table.suite_version}",
        header=["Agent", *table.columns],
        rows=[
            [marked(row.agent, row.privileged, row.information), *(_text(table.statistic, cell) for cell in row.cells)]
            for row in table.rows
        ],
        footnotes=[
            EXPLAINED[table.statistic],
            *explained((row.privileged, row.information) for row in table.rows),
            *table.notes,
            drops_line(table.planned, table.drops, table.unreadable),
        ],
    )


def _text(statistic: str, cell: StatisticCell) -> str:
    value, low, high = (_number(statistic, one) for one in (cell.value, cell.low, cell.high))
    ends = DASH if cell.low is None and cell.high is None else f"[{low}, {high}]"
    counts = "" if statistic == "oracle" or not cell.seeds else f"\n{cell.count} of {cell.seeds}"
    return f"{value}\n{ends}{counts}"


def _number(statistic: str, value: float | None) -> str:
    if value is None:
        return DASH
    return f"{value:,.0f}" if statistic == "first-goal" else number(value)


def _csv(tables: Sequence[StatisticTable]) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(CSV_COLUMNS)
    for table in tables:
        for row in table.rows:
            for cell in row.cells:
                numbers = ["" if one is None else f"{one:.{DIGITS}f}" for one in (cell.value, cell.low, cell.high)]
                named = table.suite, row.agent, str(row.privileged).lower(), cell.task, table.statistic
                writer.writerow([*named, *numbers, cell.count, cell.seeds])
    return text.getvalue()
