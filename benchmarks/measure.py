"""Speed as a ratio: two contenders timed in turn, so that a machine's good and bad minutes reach both alike."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from math import isnan, nan
from statistics import median

from benchmarks.contenders import Contender, Process


@dataclass(frozen=True)
class Row:
    """One line of the table.

    Attributes:
        what: What of ours was measured.
        against: What it was compared with.
        bar: The ratio to reach.
        ours: Median rate in env steps a second; not a number where nothing was measured, as in all that follow.
        theirs: The same of the other.
        ratio: Median of the pairs' ratios.
        our_peak: Peak resident memory of our process, in bytes.
        their_peak: The same of the other.
    """

    what: str
    against: str
    bar: float
    ours: float = nan
    theirs: float = nan
    ratio: float = nan
    our_peak: float = nan
    their_peak: float = nan

    @property
    def verdict(self) -> str:
        """Why the bar is not reached, or nothing."""
        if isnan(self.ratio):
            return "Not measured"
        return "" if self.ratio >= self.bar else "Below its bar"


def compare(what: str, ours: Contender, against: str, theirs: Contender, *, bar: float, repeats: int = 7) -> Row:
    """Time both contenders `repeats` times in turn, after one unmeasured turn each."""
    lacks = ours.lacks or theirs.lacks
    if lacks:
        return Row(what, f"{against} (needs {lacks})", bar)
    with Process(ours) as us, Process(theirs) as them:
        us.turn(), them.turn()
        pairs = [(us.turn(), them.turn()) for _ in range(repeats)]
    our_rates, their_rates = zip(*pairs, strict=True)
    ratio = median(our_rate / their_rate for our_rate, their_rate in pairs)
    return Row(what, against, bar, median(our_rates), median(their_rates), ratio, us.peak or nan, them.peak or nan)


def table(rows: Iterable[Row]) -> str:
    """Return the rows as aligned text."""
    head = ("what", "against", "ours, steps/s", "theirs, steps/s", "ratio", "bar", "our peak, MB", "their peak, MB")
    lines = [head, *map(_cells, rows)]
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    return "\n".join(_line(cells, widths) for cells in lines)


def _cells(row: Row) -> tuple[str, ...]:
    rates = [_whole(rate) for rate in (row.ours, row.theirs)]
    peaks = [_whole(peak / 1e6) for peak in (row.our_peak, row.their_peak)]
    ratio = "not measured" if isnan(row.ratio) else f"{row.ratio:,.2f}x"
    return (row.what, row.against, *rates, ratio, f"{row.bar:,g}x", *peaks)


def _whole(value: float) -> str:
    return "-" if isnan(value) else f"{value:,.0f}"


def _line(cells: Iterable[str], widths: Iterable[int]) -> str:
    """Align the first two cells to the left and the numbers to the right."""
    left, right = str.ljust, str.rjust
    sides = [left, left, *[right] * 6]
    return "  ".join(side(cell, width) for side, cell, width in zip(sides, cells, widths, strict=True)).rstrip()
