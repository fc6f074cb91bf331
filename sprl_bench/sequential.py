"""A rule for looking at the result after each new seed, without deciding too often by chance.

Looking at a p-value again and again finds a difference where there is none in far more than 5 % of cases. AdaStop
(Mathieu et al., AdaStop: Adaptive Statistical Testing for Sound Comparisons of Deep RL Agents, 2023) solves this with a
group-sequential permutation test. It permutes scores within each group of new seeds of both sides. Here one side is
finished, and the other grows by one seed at a time, so ranks are permuted instead: the statistic is the stratified
Mann-Whitney statistic, which is the probability of improvement.

Under the null hypothesis the ranks of all runs of a task are exchangeable. So the distribution of the largest statistic
over all looks does not depend on the scores, only on the numbers of seeds, tasks and looks. It is simulated, and its
upper 5 % point is the boundary of every look (constant, as Pocock's, Group Sequential Methods in the Design and
Analysis of Clinical Trials, 1977). The number of looks must be chosen before the first look. Ties count one half, which
makes the rule more careful.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Final

import numpy as np

from sprl_bench.power import spread_out
from sprl_bench.scores import Array

LOOKS: Final = 30
SIMULATIONS: Final = 20_000
CONTINUATIONS: Final = 1_000
SEED: Final = 20210706


@dataclass(frozen=True)
class Decision:
    """What the rule says.

    Attributes:
        look: The first look that decides, from 1; None if none has yet.
        better: Whether the growing side scores higher, if it is decided.
        seen: How many looks there have been.
        looks: How many there may be.
    """

    look: int | None
    better: bool
    seen: int
    looks: int


def statistics(scores: Array, reference: Array) -> Array:
    """Return the standardised Mann-Whitney statistic after each seed, [..., S].

    Args:
        scores: [..., S, T], in the order in which the seeds were finished.
        reference: [..., S', T].
    """
    seeds, tasks = scores.shape[-2:]
    others = reference.shape[-2]
    ours, theirs = scores[..., :, None, :], reference[..., None, :, :]
    wins = ((ours > theirs) + 0.5 * (ours == theirs)).sum(axis=(-1, -2)).cumsum(axis=-1)
    looks = np.arange(1, seeds + 1)
    deviation = np.sqrt(tasks * looks * others * (looks + others + 1) / 12)
    return np.asarray((wins - tasks * looks * others / 2) / deviation)


@cache
def boundary(others: int, tasks: int, looks: int = LOOKS, alpha: float = 0.05) -> float:
    """Return the value that the statistic of any look reaches with probability alpha where there is no difference.

    Args:
        others: Seeds of the finished side.
        tasks: Their number.
        looks: How often one may look: after each of so many seeds.
        alpha: The probability of a wrong decision, over all looks together.
    """
    generator = np.random.default_rng(SEED)
    largest = np.concatenate([_largest(others, tasks, looks, generator) for _ in range(SIMULATIONS // 1_000)])
    values, counts = np.unique(largest, return_counts=True)
    at_least = counts[::-1].cumsum()[::-1] / SIMULATIONS
    usual = np.flatnonzero(at_least <= alpha)
    return float(values[usual[0]]) if usual.size else float("inf")


def _largest(others: int, tasks: int, looks: int, generator: np.random.Generator) -> Array:
    """Simulate a thousand comparisons without a difference, and return the largest statistic of each."""
    ours, theirs = generator.random((1_000, looks, tasks)), generator.random((1_000, others, tasks))
    return np.asarray(np.round(np.abs(statistics(ours, theirs)).max(axis=-1), 9))


def decide(scores: Array, reference: Array, *, looks: int = LOOKS, alpha: float = 0.05) -> Decision:
    """Return what the rule says after each of the first side's seeds.

    Args:
        scores: [S, T], in the order in which the seeds were finished; those beyond `looks` do not count.
        reference: [S', T], the finished side.
        looks: How often one may look, chosen before the first look.
        alpha: The probability of a wrong decision, over all looks together.

    Raises:
        ValueError: There may be no look.
    """
    if looks < 1:
        raise ValueError(f"looks is {looks}; it must be at least 1.")
    path = statistics(scores[:looks], reference)
    reached = np.flatnonzero(np.abs(path) >= boundary(len(reference), scores.shape[1], looks, alpha) - 1e-9)
    if not reached.size:
        return Decision(None, False, len(path), looks)
    return Decision(int(reached[0]) + 1, bool(path[reached[0]] > 0), len(path), looks)


def looks_to_decide(scores: Array, reference: Array, share: float = 0.8, *, looks: int = LOOKS) -> int | None:
    """Return after how many looks the rule has decided in a share of resampled continuations; None if in fewer.

    The seeds that there are stay as they are; the later ones are drawn from them, as in `sprl_bench.power`.
    """
    generator, seen = np.random.default_rng(SEED), len(scores[:looks])
    more = generator.integers(len(scores), size=(CONTINUATIONS, looks - seen, scores.shape[1]))
    drawn = np.take_along_axis(spread_out(scores)[None], more, axis=1)
    known = np.broadcast_to(scores[:looks], (CONTINUATIONS, seen, scores.shape[1]))
    paths = np.abs(statistics(np.concatenate([known, drawn], axis=1), reference[None]))
    decided = np.maximum.accumulate(paths, axis=1) >= boundary(len(reference), scores.shape[1], looks) - 1e-9
    enough = np.flatnonzero(decided.mean(axis=0) >= share)
    return int(enough[0]) + 1 if enough.size else None
