"""From scores to a verdict on a claim: supported, contradicted, or not decided.

A claim is that some difference is above 0. It is supported if the 95 % bootstrap interval of the difference lies above
0, contradicted if it lies below, and else not decided. Then the number of seeds that would decide follows from the
interval's half-width w, which falls with the root of the number of seeds n: if the difference d stays as it is,
n (w / |d|)^2 seeds have an interval that just excludes 0.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from sprl_bench.scores import Array, Interval

Outcome = Literal["supported", "contradicted", "not decided"]

RESAMPLES = 10_000
SEED = 20210706  # of every interval
MOST = 1_000  # seeds; more are "more than 1,000"


@dataclass(frozen=True)
class Difference:
    """One difference that a claim rests on.

    Attributes:
        what: What is compared, such as "k = 5 minus k = 3".
        value: The difference.
        interval: 95 %; None for a single seed.
        seeds: The smaller number of seeds of the two sides.
    """

    what: str
    value: float
    interval: Interval | None
    seeds: int

    @property
    def outcome(self) -> Outcome:
        """What it says about a claim that it is above 0."""
        if self.interval is None:
            return "not decided"
        return "supported" if self.interval.low > 0 else "contradicted" if self.interval.high < 0 else "not decided"

    @property
    def more_seeds(self) -> int | None:
        """How many more seeds would decide; None if it is decided, or if nothing can be said."""
        if self.interval is None or self.outcome != "not decided" or self.value == 0:
            return None
        ratio = (self.interval.high - self.interval.low) / 2 / abs(self.value)
        return max(1, math.ceil(self.seeds * ratio**2) - self.seeds) if ratio < MOST else MOST + 1

    @property
    def ends(self) -> str:
        """The interval as text."""
        return f"[{self.interval.low:.3f}, {self.interval.high:.3f}]" if self.interval else "no interval"

    def __str__(self) -> str:
        """Return the difference with its interval."""
        return f"{self.what}: {self.value:+.3f}, {self.ends}"


@dataclass(frozen=True)
class Verdict:
    """What the evidence says about a claim.

    Attributes:
        outcome: Whether it holds.
        differences: What it rests on.
        why: Why nothing can be said; empty if `differences` say it.
        fact: What was counted exactly, where no interval is needed.
    """

    outcome: Outcome
    differences: tuple[Difference, ...]
    why: str = ""
    fact: str = ""

    @property
    def sentence(self) -> str:
        """The verdict in words, with what would decide it."""
        if not self.differences:
            return self.short
        return f"{self.outcome.capitalize()}: {'; '.join(map(str, self.differences))}. {self._advice}".rstrip()

    @property
    def short(self) -> str:
        """The same without the differences."""
        outcome = self.outcome.capitalize()
        if self.why or self.fact:
            return f"{outcome}: {self.why or self.fact}."
        return f"{outcome}. {self._advice}".rstrip()

    @property
    def _advice(self) -> str:
        """What would decide; empty where it is decided."""
        if self.outcome != "not decided":
            return ""
        needed = [one.more_seeds for one in self.differences if one.more_seeds is not None]
        if not needed and all(one.interval is not None for one in self.differences):
            return "Every difference is 0: these runs do not tell the agents apart."
        if not needed:
            return "One seed decides nothing; run at least two, better five."
        most = max(needed)
        number = f"about {most}" if most <= MOST else f"more than {MOST:,}"
        return f"If the differences stay as they are, {number} more seed{'s' * (most != 1)} would decide."


def nothing(why: str) -> Verdict:
    """Return the verdict where there is nothing to judge by."""
    return Verdict("not decided", (), why)


def all_above(differences: Sequence[Difference]) -> Verdict:
    """Judge the claim that all differences are above 0: one that is below contradicts it."""
    outcomes = {one.outcome for one in differences}
    if outcomes == {"supported"}:
        return Verdict("supported", tuple(differences))
    return Verdict("contradicted" if "contradicted" in outcomes else "not decided", tuple(differences))


def difference(what: str, plus: Sequence[Array], minus: Sequence[Array]) -> Difference:
    """Return the mean of some scores minus that of others, with its interval.

    Args:
        what: What is compared.
        plus: Scores by seed, [S] each, such as one array a task; their means are averaged.
        minus: Likewise. Seeds are resampled within each array, independently.
    """
    return combination(what, [*((1 / len(plus), one) for one in plus), *((-1 / len(minus), one) for one in minus)])


def combination(what: str, parts: Sequence[tuple[float, Array]]) -> Difference:
    """Return a weighted sum of means over seeds, with its interval; the arrays are resampled independently."""
    generator = np.random.default_rng(SEED)
    value = sum(weight * float(one.mean()) for weight, one in parts)
    seeds = min(len(one) for _, one in parts)
    if seeds < 2:
        return Difference(what, value, None, seeds)
    drawn = np.zeros(RESAMPLES)
    for weight, one in parts:
        drawn += weight * one[generator.integers(len(one), size=(RESAMPLES, len(one)))].mean(axis=1)
    low, high = np.percentile(drawn, [2.5, 97.5])
    return Difference(what, value, Interval(float(low), float(high)), seeds)


def best(claimed: str, scores: Mapping[str, Sequence[Array]]) -> Verdict:
    """Judge the claim that one value has a higher mean score than each other one.

    Args:
        claimed: The value.
        scores: Of each value, by its name: one array [S] a task.
    """
    others = [name for name in scores if name != claimed]
    return all_above([difference(f"{claimed} minus {name}", scores[claimed], scores[name]) for name in others])
