"""Text in rows and columns with a title and footnotes, for a terminal, a page and a paper; and JSON."""

from __future__ import annotations

import io
import json
import re
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import zip_longest
from types import MappingProxyType
from typing import Final

from rich import box
from rich.console import Console
from rich.table import Table as RichTable
from rich.text import Text

from sprl_bench.records import Data

NEGATIVE: Final = re.compile(r"(?<![\w-])-(?=\d+\.\d|\.\d)")  # the sign of a number, not a hyphen in a name
DIGITS = 6  # decimals in CSV and JSON: few enough to be the same on every machine


@dataclass(frozen=True)
class Grid:
    """A table as text: the first column is names, the others are numbers, and a cell may have several lines.

    Attributes:
        title: A line above.
        header: The names of the columns.
        rows: Texts, one a column.
        footnotes: Lines below.
        leaders: Row and column of each number that a paper shows in bold.
    """

    title: str
    header: Sequence[str]
    rows: Sequence[Sequence[str]]
    footnotes: Sequence[str]
    leaders: Collection[tuple[int, int]] = ()

    def only(self, places: Sequence[int]) -> Grid:
        """Return these columns alone."""
        return replace(
            self,
            header=[self.header[place] for place in places],
            rows=[[row[place] for place in places] for row in self.rows],
            leaders={(row, places.index(place)) for row, place in self.leaders if place in places},
        )


def draw(grids: Sequence[Grid], form: str, *, width: int | None = None) -> str:
    """Return grids as text that ends in a newline.

    Args:
        grids: One below the other.
        form: One of `GRID_FORMATS`.
        width: Columns of the terminal for "rich"; None for plain text of any width.
    """
    return _rich(grids, width) if form == "rich" else "\n".join(map(WRITERS[form], grids))


def number(value: float, sign: str = "") -> str:
    """Return a score with three decimals and no negative zero; `sign` "+" shows the sign of a difference."""
    return f"{round(value, 3) + 0.0:{sign}.3f}"


def as_json(data: Sequence[Data]) -> str:
    """Return data as JSON with six decimals."""
    return json.dumps([_rounded(one.model_dump(mode="json")) for one in data], indent=1, allow_nan=False) + "\n"


def _rounded(value: object) -> object:
    if isinstance(value, float):
        return round(value, DIGITS)
    if isinstance(value, list):
        return [_rounded(item) for item in value]
    if isinstance(value, dict):
        return {name: _rounded(item) for name, item in value.items()}
    return value


def _rich(grids: Sequence[Grid], width: int | None) -> str:
    console = Console(width=width or 10_000, file=io.StringIO(), force_terminal=width is not None)
    with console.capture() as captured:
        for grid in grids:
            console.print(Text(grid.title, style="bold"))
            console.print(_rich_table(grid))
            for line in grid.footnotes:
                console.print(Text(line, style="dim"))
            console.print()
    return "\n".join(line.rstrip() for line in captured.get().rstrip().splitlines()) + "\n"


def _rich_table(grid: Grid) -> RichTable:
    table = RichTable(box=box.SIMPLE_HEAD, pad_edge=False, padding=(0, 1, 0, 0))
    for column, name in enumerate(map(_folded, grid.header)):
        narrowest = max(len(line) for line in name.split("\n"))
        table.add_column(Text(name), justify="right" if column else "left", no_wrap=not column, min_width=narrowest)
    for row in grid.rows:
        table.add_row(*(Text(text) for text in row))
    return table


def _folded(name: str) -> str:
    """Return a task's name on two lines, so that its column is as narrow as its numbers."""
    front, dash, end = name.rpartition("-")
    return f"{front}-\n{end}" if dash else name


def _flat(text: str) -> str:
    return " ".join(text.split("\n"))


def _markdown(grid: Grid) -> str:
    lines = [grid.header, ["---", *["---:"] * (len(grid.header) - 1)], *grid.rows]
    table = "\n".join("| " + " | ".join(_markdown_escape(_flat(text)) for text in line) + " |" for line in lines)
    notes = "\n".join(f"- {_markdown_escape(line)}" for line in grid.footnotes)
    return f"### {_markdown_escape(grid.title)}\n\n{table}\n\n{notes}\n"


def _markdown_escape(text: str) -> str:
    escaped = "".join(f"\\{letter}" if letter in "\\`*<>|" else letter for letter in text)
    return escaped.replace("](", "]\\(")


def _latex(grid: Grid) -> str:
    """Return a table for a column of a paper: intervals below their numbers, names of tasks on two lines."""
    header = _latex_lines([_folded(name) for name in grid.header])
    body = [line for number, row in enumerate(grid.rows) for line in _latex_row(row, number, grid.leaders)]
    notes = [rf"{{\raggedright\footnotesize {_latex_escape(line)}\par}}" for line in grid.footnotes]
    lines = [
        rf"% {grid.title}; needs \usepackage{{booktabs}}",
        r"{\footnotesize\setlength{\tabcolsep}{3pt}%",
        rf"\begin{{tabular}}{{@{{}}l{'r' * (len(grid.header) - 1)}@{{}}}}",
        r"\toprule",
        *(" & ".join(map(_latex_escape, line)) + r" \\" for line in header),
        r"\midrule",
        *body,
        r"\bottomrule",
        r"\end{tabular}\par}",
        *([r"\smallskip"] if notes else []),
        *notes,
    ]
    return "\n".join(lines) + "\n"


def _latex_lines(texts: Sequence[str]) -> Iterator[tuple[str, ...]]:
    """Yield each line of cells with several lines."""
    yield from zip_longest(*(text.split("\n") for text in texts), fillvalue="")


def _latex_row(texts: Sequence[str], row: int, leaders: Collection[tuple[int, int]]) -> Iterator[str]:
    """Yield a row's numbers, and below them, in small letters, their intervals."""
    first, *others = _latex_lines(texts)
    cells = map(_latex_escape, first)
    yield " & ".join(rf"\textbf{{{cell}}}" if (row, n) in leaders else cell for n, cell in enumerate(cells)) + r" \\"
    for line in others:
        yield " & ".join(rf"{{\scriptsize {_latex_escape(cell)}}}" if cell else "" for cell in line) + r" \\"


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
    return NEGATIVE.sub("$-$", "".join(LATEX.get(letter, letter) for letter in text))


WRITERS: Mapping[str, Callable[[Grid], str]] = MappingProxyType({"latex": _latex, "md": _markdown})
GRID_FORMATS = ("rich", *WRITERS)
