"""The pages that name tests as evidence name such as exist, and each promise and each threat has one."""

from __future__ import annotations

import ast
import re
from pathlib import Path
from typing import Final

import pytest

ROOT: Final = Path(__file__).parents[2]
PAGES: Final = ("SECURITY.md", "docs/trust.md")
NAMED: Final = re.compile(r"`(tests/[\w/]+\.py)(?:::(\w+))?`")


def rows_of(page: str) -> list[str]:
    """Return the rows of a page's tables that have a column of tests."""
    rows, wanted = [], False
    for line in (ROOT / page).read_text().splitlines():
        cells = [cell.strip() for cell in line.strip("|").split("|")] if line.startswith("|") else []
        if not cells:
            wanted = False
        elif cells[-1] in ("tests", "test"):
            wanted = True
        elif wanted and not set(cells[0]) <= {"-", ":"}:
            rows.append(line)
    return rows


def functions_of(file: Path) -> set[str]:
    return {node.name for node in ast.walk(ast.parse(file.read_text())) if isinstance(node, ast.FunctionDef)}


@pytest.mark.parametrize("page", PAGES)
def test_every_test_that_is_named_exists(page: str) -> None:
    named = NAMED.findall((ROOT / page).read_text())
    assert named
    assert [file for file, _ in named if not (ROOT / file).is_file()] == []
    assert [name for file, name in named if name and name not in functions_of(ROOT / file)] == []


@pytest.mark.parametrize(("page", "least"), [("SECURITY.md", 10), ("docs/trust.md", 6)])
def test_every_row_names_a_test(page: str, least: int) -> None:
    rows = rows_of(page)
    assert len(rows) >= least
    assert [row for row in rows if not any(name for _, name in NAMED.findall(row))] == []


def test_a_name_that_does_not_exist_would_be_noticed() -> None:
    [(file, name)] = NAMED.findall("| forged | `tests/test_replay.py::test_a_forged_curve_is_lost` |")
    assert (ROOT / file).is_file()
    assert name not in functions_of(ROOT / file)
