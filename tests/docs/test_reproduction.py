"""The pages of what reproduces and of Fetch follow from the entries, the finished runs and the studies."""

from __future__ import annotations

import runpy
from pathlib import Path

import numpy as np
from PIL import Image

from sprl_bench import leaderboard, plots

DOCS = Path(__file__).parents[2] / "docs"


def test_the_page_is_what_the_entries_say() -> None:
    """If this fails: python docs/write_reproduction.py docs/reproduction.md."""
    made = runpy.run_path(str(DOCS / "write_reproduction.py"))["page"]()
    assert (DOCS / "reproduction.md").read_text() == made


def test_the_page_on_fetch_is_what_the_runs_say() -> None:
    """If this fails: python docs/write_fetch.py docs/fetch.md."""
    made = runpy.run_path(str(DOCS / "write_fetch.py"))["page"]()
    assert (DOCS / "fetch.md").read_text() == made


def test_every_study_has_a_row() -> None:
    page = (DOCS / "reproduction.md").read_text()
    for figure in ("fig10", "fig12", "fig14", "fig15", "fig16", "fig17", "fig20", "fig21", "fig22", "sec6.6"):
        assert f"`sprl-bench reproduce {figure}" in page
    for missing in ("9", "11", "13", "18", "19"):
        assert missing in page[page.index("**Not measured here**") :]


def test_a_verdict_never_contradicts_its_interval() -> None:
    for line in (DOCS / "reproduction.md").read_text().splitlines():
        if line.startswith("| ") and "mean AUC" in line:
            low, high = (float(end) for end in line[line.index("[") + 1 : line.index("]")].split(", "))
            expected = "supported" if low > 0 else "contradicted" if high < 0 else "not decided"
            assert f"| {expected} |" in line


def test_the_picture_of_the_board_is_that_of_its_entries(tmp_path: Path) -> None:
    """If this fails: sprl-bench leaderboard plot grid-7x7 -o docs/grid-7x7.png."""
    drawn = tmp_path / "board.png"
    plots.plot_results([one for entry in leaderboard.find_board("grid-7x7") for one in entry.results()], drawn)
    ours, published = (np.asarray(Image.open(path).convert("RGB"), float) for path in (drawn, DOCS / "grid-7x7.png"))
    assert ours.shape == published.shape
    assert np.abs(ours - published).mean() < 1  # of 255: letters may be smoothed in another way
