"""Five ways to write a table down: for a terminal, a page, a spreadsheet, a paper and a program.

All of them say the same: which agents are privileged, how many seeds there are, and what is missing.
"""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from types import MappingProxyType

from rich import box
from rich.console import Console
from rich.table import Table as RichTable
from rich.text import Text

from sprl_bench.suggestions import unknown
from sprl_bench.tables.table import Cell, Estimate, Row, Table

__all__ = ["FORMATS", "render"]

DIGITS = 6
"""Decimals in the formats for machines: enough for any use, and the same on every machine."""

PRIVILEGED = "privileged: sees what an ordinary agent does not."
PARTIAL = "some of its runs are missing; overall figures are over the seeds that every task has."
SCORES = "Mean AUC with its 95 % stratified-bootstrap interval; final and success over the last tenth of the budget."
MEASURES = ("auc", "final", "success_auc", "success_final")
DASH = "-"


def render(tables: Sequence[Table], form: str = "md", *, width: int | None = None) -> str:
    """Return tables as text that ends in a newline.

    Args:
        tables: One a suite.
        form: One of `FORMATS`.
        width: Columns of the terminal for "rich"; None for as many as the table needs.

    Raises:
        ValueError: There is no such format.
    """
    if form not in FORMATS:
        raise ValueError(unknown("format", form, FORMATS))
    return _rich(tables, width) if form == "rich" else WRITERS[form](tables)


def _rich(tables: Sequence[Table], width: int | None) -> str:
    console = Console(width=width or 10_000, file=io.StringIO(), force_terminal=width is not None)
    with console.capture() as captured:
        for table in tables:
            console.print(Text(_title(table), style="bold"), end="\n\n")
            console.print(_rich_grid(table))
            for line in _footnotes(table):
                console.print(Text(line, style="dim"))
            console.print()
    return captured.get().rstrip() + "\n"


def _rich_grid(table: Table) -> RichTable:
    grid = RichTable(box=box.SIMPLE_HEAD, pad_edge=False)
    for number, name in enumerate(_header(table)):
        grid.add_column(Text(name), justify="left" if number == 0 else "right", no_wrap=number == 0)
    for row in table.rows:
        grid.add_row(*(Text(text) for text in _texts(row, separator="\n")))
    return grid


def _markdown(tables: Sequence[Table]) -> str:
    return "\n".join(_markdown_table(table) for table in tables)


def _markdown_table(table: Table) -> str:
    header = _header(table)
    lines = [header, ["---", *["---:"] * (len(header) - 1)], *(_texts(row) for row in table.rows)]
    grid = "\n".join("| " + " | ".join(_markdown_escape(text) for text in line) + " |" for line in lines)
    notes = "\n".join(f"- {_markdown_escape(line)}" for line in _footnotes(table))
    return f"### {_markdown_escape(_title(table))}\n\n{grid}\n\n{notes}\n"


def _markdown_escape(text: str) -> str:
    return "".join(f"\\{letter}" if letter in "\\`*_<>|" else letter for letter in text)


def _latex(tables: Sequence[Table]) -> str:
    return "\n".join(_latex_table(table) for table in tables)


def _latex_table(table: Table) -> str:
    header = _header(table)
    body = [" & ".join(_latex_escape(text) for text in _texts(row)) + r" \\" for row in table.rows]
    notes = [
        rf"\multicolumn{{{len(header)}}}{{l}}{{\footnotesize {_latex_escape(line)}}} \\" for line in _footnotes(table)
    ]
    return "\n".join(
        [
            rf"% {_title(table)}; needs \usepackage{{booktabs}}",
            rf"\begin{{tabular}}{{l{'r' * (len(header) - 1)}}}",
            r"\toprule",
            " & ".join(_latex_escape(name) for name in header) + r" \\",
            r"\midrule",
            *body,
            r"\bottomrule",
            *notes,
            r"\end{tabular}",
            "",
        ]
    )


LATEX = MappingProxyType(
    {
        "\\": r"\textbackslash{}",
        "~": r"\textasciitilde{}",
        "^": r"\textasciicircum{}",
        "†": r"$^\dagger$",
        "‡": r"$^\ddagger$",
        **{letter: f"\\{letter}" for letter in "&%$#_{}"},
    }
)


def _latex_escape(text: str) -> str:
    return "".join(LATEX.get(letter, letter) for letter in text)


def _json(tables: Sequence[Table]) -> str:
    data = [_rounded(table.model_dump(mode="json")) for table in tables]
    return json.dumps(data, indent=1, allow_nan=False) + "\n"


def _rounded(value: object) -> object:
    if isinstance(value, float):
        return round(value, DIGITS)
    if isinstance(value, list):
        return [_rounded(item) for item in value]
    if isinstance(value, dict):
        return {name: _rounded(item) for name, item in value.items()}
    return value


CSV_COLUMNS = (
    "suite",
    "suite_version",
    "agent",
    "privileged",
    "task",
    "measure",
    "value",
    "low",
    "high",
    "seeds",
    "missing",
)


def _csv(tables: Sequence[Table]) -> str:
    """One line a number; the task "all" is the whole suite."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(CSV_COLUMNS)
    for table in tables:
        for row in table.rows:
            for line in _csv_lines(row):
                writer.writerow([table.suite, table.suite_version, row.agent, str(row.privileged).lower(), *line])
    return text.getvalue()


def _csv_lines(row: Row) -> Iterator[list[object]]:
    missing = sum(len(cell.missing) for cell in row.cells)
    overall = {"auc": row.auc, "auc_iqm": row.auc_iqm, **{name: getattr(row, name) for name in MEASURES[1:]}}
    for cell in row.cells:
        for name in MEASURES:
            yield [cell.task, name, *_numbers(getattr(cell, name)), len(cell.missing)]
    for name, value in overall.items():
        yield ["all", name, *_numbers(value), missing]


def _numbers(value: Estimate | None) -> list[object]:
    if value is None:
        return ["", "", "", 0]
    low, high = (f"{end:.{DIGITS}f}" for end in value.interval) if value.interval else ("", "")
    return [f"{value.value:.{DIGITS}f}", low, high, value.seeds]


def _title(table: Table) -> str:
    return f"Suite {table.suite}, version {table.suite_version}"


def _header(table: Table) -> list[str]:
    return ["Agent", "Seeds", *table.tasks, "Mean AUC", "IQM", "Final", "Success"]


def _texts(row: Row, separator: str = " ") -> list[str]:
    return [
        row.agent + " †" * row.privileged + " ‡" * (not row.complete),
        str(len(row.seeds)),
        *(_cell(cell, separator) for cell in row.cells),
        _with_interval(row.auc, separator),
        _with_interval(row.auc_iqm, separator),
        DASH if row.final is None else f"{row.final.value:.3f}",
        DASH if row.success_final is None else f"{row.success_final.value:.3f}",
    ]


def _cell(cell: Cell, separator: str) -> str:
    wanted = len(cell.seeds) + len(cell.missing)
    if cell.auc is None:
        return f"{DASH}{separator}0 of {wanted}" if wanted else DASH
    text = _with_interval(cell.auc, separator)
    return f"{text}{separator}{len(cell.seeds)} of {wanted}" if cell.missing else text


def _with_interval(value: Estimate | None, separator: str) -> str:
    if value is None:
        return DASH
    if value.interval is None:
        return f"{value.value:.3f}{separator}{DASH}"
    return f"{value.value:.3f}{separator}[{value.interval.low:.3f}, {value.interval.high:.3f}]"


def _footnotes(table: Table) -> list[str]:
    return [
        SCORES,
        *([f"† {PRIVILEGED}"] if any(row.privileged for row in table.rows) else []),
        *([f"‡ {PARTIAL}"] if not all(row.complete for row in table.rows) else []),
        *table.notes,
    ]


WRITERS: Mapping[str, Callable[[Sequence[Table]], str]] = MappingProxyType(
    {"csv": _csv, "json": _json, "latex": _latex, "md": _markdown}
)
FORMATS = ("rich", *WRITERS)
