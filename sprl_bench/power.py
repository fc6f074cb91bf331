"""Power: how many seeds decide whether two methods differ, by resampling the seeds that there are.

An experiment of n seeds is drawn from the scores at hand, with replacement and within each task, and the permutation
test is applied to it. Power is the share of such experiments whose p-value is at most alpha (Colas, Sigaud and
Oudeyer, How Many Random Seeds?, 2018; Efron and Tibshirani, An Introduction to the Bootstrap, 1993, chapter 25). Few
seeds look more alike than they are: their deviations from the mean are scaled by sqrt(S / (S - 1)), which makes their
variance unbiased.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np

from sprl_bench.scores import Array

ALPHA: Final = 0.05
POWER: Final = 0.8
TRIALS: Final = 400  # experiments drawn for one power
RELABELLINGS: Final = 999  # of each experiment
ROUNDING: Final = 1e-12
MOST: Final = 1_000  # seeds; where more are needed the answer is None


def power(
    scores: Array, reference: Array, seeds: tuple[int, int], generator: np.random.Generator, *, alpha: float = ALPHA
) -> float:
    """Return the probability that so many seeds of each side have a permutation p-value of at most alpha.

    Args:
        scores: [S, T], the scores at hand.
        reference: [S', T], likewise.
        seeds: How many seeds each side has in the experiment.
        generator: The same generator state gives the same power.
        alpha: The largest p-value that decides.

    Raises:
        ValueError: A side has a single seed, so its spread is unknown.
    """
    ours, theirs = _drawn(scores, seeds[0], generator), _drawn(reference, seeds[1], generator)
    observed = np.abs((ours.mean(axis=1) - theirs.mean(axis=1)).mean(axis=-1))
    pooled = np.concatenate([ours, theirs], axis=1)
    by_task = [pooled[..., task] @ _weights(*seeds, generator) for task in range(pooled.shape[-1])]
    relabelled = np.abs(np.mean(by_task, axis=0))  # [trials, relabellings]
    extreme = (relabelled >= observed[:, None] - ROUNDING).sum(axis=1)
    return float(np.mean((1 + extreme) / (1 + RELABELLINGS) <= alpha))


def spread_out(scores: Array) -> Array:
    """Return scores [S, T] whose deviations from each task's mean have an unbiased variance.

    Raises:
        ValueError: There is a single seed.
    """
    seeds = len(scores)
    if seeds < 2:
        raise ValueError("scores has a single seed; it must have at least two to know their spread.")
    mean = scores.mean(axis=0)
    return np.asarray(mean + (scores - mean) * np.sqrt(seeds / (seeds - 1)))


def _drawn(scores: Array, seeds: int, generator: np.random.Generator) -> Array:
    """Draw experiments [TRIALS, seeds, T], each task on its own."""
    chosen = generator.integers(len(scores), size=(TRIALS, seeds, scores.shape[1]))
    return np.take_along_axis(spread_out(scores)[None], chosen, axis=1)


def _weights(ours: int, theirs: int, generator: np.random.Generator) -> Array:
    """Return relabellings as weights [seeds of both, RELABELLINGS], of a difference of means."""
    weights = np.repeat([1 / ours, -1 / theirs], [ours, theirs])
    return np.asarray(generator.permuted(np.tile(weights, (RELABELLINGS, 1)), axis=1).T)


def seeds_needed(
    scores: Array, reference: Array, seed: int, *, both: bool = False, alpha: float = ALPHA, target: float = POWER
) -> int | None:
    """Return the smallest number of seeds of the first side whose power reaches the target.

    Args:
        scores: [S, T], the scores at hand.
        reference: [S', T], likewise.
        seed: Of the generator; the same seed gives the same number.
        both: Whether the reference gets as many seeds as the first side; else it keeps its own.
        alpha: The largest p-value that decides.
        target: The power.

    Returns:
        That number, at least S; None where `MOST` seeds do not reach it.
    """

    def suffices(seeds: int) -> bool:
        sides = seeds, max(seeds, len(reference)) if both else len(reference)
        return power(scores, reference, sides, np.random.default_rng(seed), alpha=alpha) >= target

    return _smallest(suffices, len(scores), MOST)


def _smallest(suffices: Callable[[int], bool], least: int, most: int) -> int | None:
    """Return the smallest number of a range that suffices, if all above it do, too: by doubling and halving."""
    if suffices(least):
        return least
    step, low = 1, least
    while low + step < most and not suffices(low + step):
        low, step = low + step, 2 * step
    high = min(low + step, most)
    if not suffices(high):
        return None
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if suffices(middle) else (middle, high)
    return high
