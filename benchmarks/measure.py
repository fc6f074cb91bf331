"""Speed as a ratio: two contenders timed in turn, so that a machine's good and bad minutes reach both alike."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass

Contender = Callable[[], int]
"""Does a fixed piece of work and returns how many env steps it was."""


@dataclass(frozen=True)
class Row:
    """One line of the table. Rates are medians in env steps a second; the ratio is the median of the pairs' ratios."""

    what: str
    against: str
    ours: float
    theirs: float
    ratio: float
    bar: float

    @property
    def passed(self) -> bool:
        """Whether the bar is reached; a row that could not be measured has not reached it."""
        return self.ratio >= self.bar


def compare(what: str, ours: Contender, against: str, theirs: Contender, *, bar: float, repeats: int = 7) -> Row:
    """Time both contenders ``repeats`` times in turn, after one unmeasured turn each."""
    ours(), theirs()
    pairs = [(_rate(ours), _rate(theirs)) for _ in range(repeats)]
    our_rates, their_rates = zip(*pairs, strict=True)
    ratio = statistics.median(our_rate / their_rate for our_rate, their_rate in pairs)
    return Row(what, against, statistics.median(our_rates), statistics.median(their_rates), ratio, bar)


def missing(what: str, against: str, *, bar: float) -> Row:
    """Return the row of a contender that is not installed."""
    nothing = float("nan")
    return Row(what, f"{against} (not installed)", nothing, nothing, nothing, bar)


def table(rows: Iterable[Row]) -> str:
    """Return the rows as aligned text."""
    head = ("what", "against", "ours, steps/s", "theirs, steps/s", "ratio", "bar")
    lines = [head]
    for row in rows:
        numbers = (f"{row.ours:,.0f}", f"{row.theirs:,.0f}", f"{row.ratio:,.2f}x", f"{row.bar:,g}x")
        lines.append((row.what, row.against, *numbers))
    widths = [max(len(line[column]) for line in lines) for column in range(len(head))]
    return "\n".join(
        "  ".join(
            cell.ljust(width) if column < 2 else cell.rjust(width)
            for column, (cell, width) in enumerate(zip(line, widths, strict=True))
        ).rstrip()
        for line in lines
    )


def _rate(contender: Contender) -> float:
    start = time.perf_counter()
    steps = contender()
    return steps / (time.perf_counter() - start)
