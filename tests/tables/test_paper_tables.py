"""LaTeX tables that fit a column: bold leaders, real minus signs, chosen columns."""

from __future__ import annotations

import re
from collections.abc import Callable

import pytest

from sprl_bench.records import RunRecord
from sprl_bench.tables import render, tabulate

MakeRecord = Callable[..., RunRecord]


def _agent(make_record: MakeRecord, name: str, levels: list[float], **others: object) -> list[RunRecord]:
    return [make_record(name, seed=seed, level=level, **others) for seed, level in enumerate(levels)]


def test_the_best_and_what_is_not_worse_are_bold(make_record: MakeRecord) -> None:
    records = [
        *_agent(make_record, "best", [0.50, 0.60, 0.70]),
        *_agent(make_record, "close", [0.45, 0.58, 0.72]),
        *_agent(make_record, "far", [0.10, 0.11, 0.12]),
        *_agent(make_record, "gt-grid", [0.90, 0.91, 0.92], privileged=True),
    ]
    text = render(tabulate(records), "latex", columns=["Mean AUC"])
    lines = {line.split(" ")[0]: line for line in text.splitlines() if " & " in line}
    bold = {name for name, line in lines.items() if r"\textbf" in line}
    assert bold == {"best", "close"}
    assert "not significant" in text


def test_minus_signs_are_those_of_mathematics_and_hyphens_stay(make_record: MakeRecord) -> None:
    records = [make_record("gt-grid", seed=seed, curve=[-0.5 - seed] * 100) for seed in range(2)]
    text = render(tabulate(records), "latex")
    assert "$-$1.000" in text
    assert "[$-$1.500, $-$0.500]" in text
    assert "gt-grid" in text
    assert not re.search(r"[ \[{]-\d", text)


def test_columns_are_chosen_in_order(grid_7x7: list[RunRecord]) -> None:
    header = render(tabulate(grid_7x7), "md", columns=["iqm", "Seeds"]).splitlines()[2]
    assert header == "| Agent | IQM | Seeds |"
    with pytest.raises(ValueError, match="Unknown column 'IQR'; did you mean 'IQM'"):
        render(tabulate(grid_7x7), "md", columns=["IQR"])


def test_a_table_of_four_columns_fits_one_of_a_paper(grid_7x7: list[RunRecord]) -> None:
    """Widths by Computer Modern's own metrics, against the 234 points of the narrowest usual column."""
    from matplotlib import cbook
    from matplotlib.ft2font import FT2Font

    font = FT2Font(str(cbook._get_data_path("fonts/ttf/cmr10.ttf")))

    def points(cell: str) -> float:
        size = 7 if r"\scriptsize" in cell else 8
        font.set_size(size, 72)
        font.set_text(re.sub(r"\\\w+|[{}$]", "", cell).strip())
        return float(font.get_width_height()[0] / 64)

    text = render(tabulate(grid_7x7), "latex", columns=["Seeds", "FourRooms-7x7", "KeyDoors-7x7", "Mean AUC"])
    rows = [line.removesuffix(r" \\").split(" & ") for line in text.splitlines() if " & " in line]
    widths = [max(map(points, column)) for column in zip(*rows, strict=True)]
    assert sum(widths) + 6 * (len(widths) - 1) < 234
