"""The boards on the site: the report of each, made as `sprl-bench report BOARD` makes it, and a page around it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Final

from sprl_bench.leaderboard import find_board, side_by_side
from sprl_bench.report import of_board, write_report
from sprl_bench.tables import tabulate_results
from sprl_bench.tables.render import render

EMBEDDED: Final = (
    '<iframe class="report" src="{source}" title="The report of the board {name}" loading="lazy"></iframe>'
)


def names_of(home: Path) -> list[str]:
    """Return the boards that have entries."""
    return sorted(folder.name for folder in home.iterdir() if any(folder.glob("*.json")))


def write_reports(home: Path, target: Path) -> None:
    """Write the report of every board into a folder."""
    target.mkdir(parents=True)
    for name in names_of(home):
        write_report(of_board(name, find_board(home / name)), target / f"{name}.html")


def page_of(home: Path, name: str) -> str:
    """Return the page of a board, for the folder `generated`."""
    results, _ = side_by_side(find_board(home / name))
    table = render([tabulate_results(results)], "md")
    lines = [f"# The board {name}\n", _links(name), embedded(name), "## Table\n", table]
    return "\n".join(lines)


def _links(name: str) -> str:
    return (
        f'<a href="../boards/{name}.html">Open the report on a page of its own</a>. It works without a network: '
        f"save it, or make it with `sprl-bench report {name}`. What the numbers say: [results](../docs/results.md). "
        "Add an agent: [how to](../leaderboards/README.md#add-an-entry).\n"
    )


def embedded(name: str) -> str:
    """Return the report of a board inside a page that is one folder below the root."""
    return f"```{{raw}} html\n{EMBEDDED.format(source=f'../boards/{name}.html', name=name)}\n```\n"


def overview(names: Sequence[str]) -> str:
    """Return the page that leads to all boards."""
    rows = [f"- [{name}](board-{name}.md)" for name in names]
    about = "A board is the leaderboard of a suite. What they say: [results](../docs/results.md).\n"
    return "\n".join(["# Boards\n", about, *rows, ""])


def beside_results(names: Sequence[str]) -> str:
    """Return what the page of results shows on the site, and cannot show on GitHub."""
    parts = [
        f"### {name}\n\n[Open it on a page of its own](../generated/board-{name}.md).\n\n{embedded(name)}"
        for name in names
    ]
    return "\n".join(["\n## Look for yourself\n", *parts])
