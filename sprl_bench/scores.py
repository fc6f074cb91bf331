"""Scores: pure functions of arrays.

A run is a curve of 100 bins over its budget; its AUC is their mean. A method is a matrix of scores, one row a seed, one
column a task; its mean, its interquartile mean and their stratified-bootstrap intervals are functions of that matrix
and of a random generator that the caller passes in.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from sprl_bench.quantiles import central_range_in_place

BINS = 100
FINAL_BINS = 10
THRESHOLD = 0.5
PART = 1 << 15  # numbers that are resampled at once: they fit into the cache of a processor

Array = npt.NDArray[np.float64]
Places = npt.NDArray[np.int64]
Statistic = Callable[[Array], Array]
Draw = Callable[..., npt.NDArray[Any]]


def curve(stamps: npt.ArrayLike, values: npt.ArrayLike, budget: int) -> Array:
    """Bin the episodes of one run.

    Bin b holds the episodes whose stamp lies in (b * budget / 100, (b + 1) * budget / 100]; its value is their mean. A
    bin without an episode repeats the one before it; before the first episode the value is 0.

    Args:
        stamps: [E], the environment step (from 1) at which each episode ended; those beyond the budget are dropped.
        values: [E], each episode's return or success.
        budget: Environment steps.

    Returns:
        [100], one value a bin.
    """
    steps = np.asarray(stamps, dtype=np.int64)
    scored = steps <= budget
    # Integer arithmetic: the bin of step s is ceil(100 s / budget) - 1, exactly.
    bins = -(-steps[scored] * BINS // budget) - 1
    totals = np.bincount(bins, weights=np.asarray(values, dtype=np.float64)[scored], minlength=BINS)
    counts = np.bincount(bins, minlength=BINS)
    means = np.divide(totals, counts, out=np.zeros(BINS), where=counts > 0)
    last_filled = np.maximum.accumulate(np.where(counts > 0, np.arange(BINS), -1))
    return np.where(last_filled >= 0, means[last_filled], 0.0)


def auc(bins: npt.ArrayLike) -> float:
    """Return the mean of a curve's bins, summed exactly so that every machine agrees on the last bit."""
    values = np.asarray(bins, dtype=np.float64).tolist()
    return math.fsum(values) / len(values)


def final(bins: npt.ArrayLike) -> float:
    """Return the mean of a curve's last ten bins."""
    return auc(np.asarray(bins)[-FINAL_BINS:])


def steps_to_threshold(bins: npt.ArrayLike, budget: int, score_range: tuple[float, float]) -> int | None:
    """Return the environment step at which the first bin ends that reaches half of the range.

    Returns:
        That step, or None if no bin reaches it.
    """
    low, high = score_range
    reached = np.flatnonzero(np.asarray(bins, dtype=np.float64) >= low + THRESHOLD * (high - low))
    return int((reached[0] + 1) * budget // BINS) if reached.size else None


def normalized(scores: npt.ArrayLike, reference: tuple[float, float]) -> Array:
    """Return scores on a scale on which the lower reference is 0 and the upper one 1, as random and human play are."""
    low, high = reference
    return (np.asarray(scores, dtype=np.float64) - low) / (high - low)


def mean(scores: Array) -> Array:
    """Return the mean over seeds, then over tasks, of scores [..., S, T] for S seeds and T tasks: [...]."""
    return np.asarray(scores.mean(axis=-2).mean(axis=-1))


def iqm(scores: Array) -> Array:
    """Return the interquartile mean of scores [..., S, T], of which it drops the lowest and highest quarter: [...]."""
    flat = np.sort(scores.reshape(*scores.shape[:-2], -1), axis=-1)
    cut = flat.shape[-1] // 4
    return np.asarray(flat[..., cut : flat.shape[-1] - cut].mean(axis=-1))


class Interval(NamedTuple):
    """The ends of a confidence interval."""

    low: float
    high: float


def bootstrap_interval(
    scores: Array,
    statistic: Statistic,
    generator: np.random.Generator,
    *,
    resamples: int = 10_000,
    confidence: float = 0.95,
) -> Interval | None:
    """Return a percentile interval of `statistic`, resampling seeds within each task.

    Args:
        scores: [S, T] for S seeds and T tasks.
        statistic: From [R, S, T] to [R].
        generator: The same generator state gives the same interval.
        resamples: R, the number of bootstrap samples.
        confidence: The probability that the interval aims to cover.

    Returns:
        The interval, or None for a single seed.
    """
    if scores.shape[0] < 2:
        return None
    return _percentiles(_resampled(scores, statistic, generator, resamples), confidence)


def curve_band(
    curves: Array, generator: np.random.Generator, *, resamples: int = 2_000, confidence: float = 0.95
) -> tuple[Array, Array] | None:
    """Return a percentile interval of the mean curve, bin by bin, resampling whole runs.

    Args:
        curves: [S, B] for S seeds and B bins.
        generator: The same generator state gives the same band.
        resamples: The number of bootstrap samples.
        confidence: The probability that each bin's interval aims to cover.

    Returns:
        The lower and the upper ends, each [B], or None for a single seed.
    """
    seeds = curves.shape[0]
    if seeds < 2:
        return None
    chosen = _drawn(_choose, generator, seeds, 1, resamples)[..., 0]
    return central_range_in_place(_sums(curves, chosen) / seeds, confidence)


def _sums(curves: Array, chosen: Places) -> Array:
    """Return the sum of each sample's curves, [B, R], from the places of its curves, [R, S], added in their order."""
    sums = np.empty((curves.shape[1], len(chosen)))
    rows = max(1, PART // curves.shape[1])
    for first in range(0, len(chosen), rows):
        sums[:, first : first + rows] = _sum(curves, chosen[first : first + rows]).T
    return sums


def _sum(curves: Array, chosen: Places) -> Array:
    total = curves[chosen[:, 0]]
    for column in chosen.T[1:]:
        total += curves[column]
    return total


def difference_interval(
    scores: Array,
    reference: Array,
    generator: np.random.Generator,
    *,
    statistic: Statistic = mean,
    resamples: int = 10_000,
    confidence: float = 0.95,
) -> Interval | None:
    """Return a percentile interval of statistic(scores) - statistic(reference) over the same tasks.

    Args:
        scores: [S, T].
        reference: [S', T], the same tasks in the same order; the seeds of the two are independent.
        generator: The same generator state gives the same interval.
        statistic: From [R, S, T] to [R].
        resamples: R, the number of bootstrap samples.
        confidence: The probability that the interval aims to cover.

    Returns:
        The interval, or None where either side has a single seed.

    Raises:
        ValueError: The two do not have the same number of tasks.
    """
    if scores.shape[1] != reference.shape[1]:
        raise ValueError(f"scores has {scores.shape[1]} tasks and reference {reference.shape[1]}; they must be paired.")
    if min(scores.shape[0], reference.shape[0]) < 2:
        return None
    ours = _resampled(scores, statistic, generator, resamples)
    theirs = _resampled(reference, statistic, generator, resamples)
    return _percentiles(ours - theirs, confidence)


def probability_of_improvement(scores: Array, reference: Array) -> float:
    """Return how probably a run of one method scores higher than a run of another, on a task drawn at random.

    A tie counts half. Agarwal et al., Deep RL at the Edge of the Statistical Precipice, 2021, section 4.3.

    Args:
        scores: [S, T].
        reference: [S', T], the same tasks in the same order.
    """
    return float(_wins(scores, reference).mean())


def improvement_interval(
    scores: Array,
    reference: Array,
    generator: np.random.Generator,
    *,
    resamples: int = 2_000,
    confidence: float = 0.95,
) -> Interval | None:
    """Return a percentile interval of the probability of improvement, resampling the seeds of both within each task.

    Args:
        scores: [S, T].
        reference: [S', T], the same tasks in the same order; the seeds of the two are independent.
        generator: The same generator state gives the same interval.
        resamples: The number of bootstrap samples.
        confidence: The probability that the interval aims to cover.

    Returns:
        The interval, or None where either side has a single seed.
    """
    if min(scores.shape[0], reference.shape[0]) < 2:
        return None
    ours = _drawn(_shares, generator, *scores.shape, resamples)
    theirs = _drawn(_shares, generator, *reference.shape, resamples)
    wins = np.moveaxis(_wins(scores, reference), -1, 0)  # [T, S, S']
    return _percentiles(((ours @ wins) * theirs).sum(axis=-1).mean(axis=0), confidence)


def _wins(scores: Array, reference: Array) -> Array:
    """Return 1 where a run scores higher than another, 1/2 where both score the same: [S, S', T]."""
    ours, theirs = scores[:, None], reference[None]
    return np.asarray((ours > theirs) + 0.5 * (ours == theirs))


def _shares(generator: np.random.Generator, seeds: int, tasks: int, resamples: int) -> Array:
    """Resample the seeds of each task; return each one's share of each sample: [T, R, S]."""
    chosen = generator.integers(seeds, size=(tasks * resamples, seeds)) + seeds * np.arange(tasks * resamples)[:, None]
    return np.asarray(np.bincount(chosen.ravel(), minlength=chosen.size).reshape(tasks, resamples, seeds) / seeds)


def performance_profile(scores: Array, thresholds: Array) -> Array:
    """Return the share of runs, averaged over tasks, that score more than each threshold.

    Agarwal et al., 2021, section 4.2: the higher the curve, the better.

    Args:
        scores: [..., S, T].
        thresholds: [K].

    Returns:
        [..., K].
    """
    above = scores[..., None] > thresholds
    return np.asarray(above.mean(axis=-3).mean(axis=-2))


def _resampled(scores: Array, statistic: Statistic, generator: np.random.Generator, resamples: int) -> Array:
    """Resample seeds within each task, with replacement, and return the statistic of each sample: [R]."""
    places = _drawn(_choose, generator, *scores.shape, resamples)
    flat, rows = scores.ravel(), max(1, PART // scores.size)
    parts = [statistic(flat.take(places[first : first + rows])) for first in range(0, resamples, rows)]
    return np.concatenate(parts)


def _choose(generator: np.random.Generator, seeds: int, tasks: int, resamples: int) -> Places:
    """Return places in a flat array of scores [S, T], which are quicker to look up than seeds: [R, S, T]."""
    chosen = generator.integers(seeds, size=(resamples, seeds, tasks))
    chosen *= tasks
    chosen += np.arange(tasks)
    return chosen


def _drawn(draw: Draw, generator: np.random.Generator, *sizes: int) -> npt.NDArray[Any]:
    """Return `draw(generator, *sizes)`, read-only; the last few draws are remembered by the state they begin from.

    The intervals of a table all begin from one state, so they share their draws.
    """
    bits = generator.bit_generator
    if not isinstance(bits, np.random.PCG64):
        return draw(generator, *sizes)
    before: Any = bits.state
    drawn, after = _remembered(draw, sizes, *before["state"].values(), before["has_uint32"], before["uinteger"])
    bits.state = after
    return drawn


@lru_cache(maxsize=6)
def _remembered(
    draw: Draw, sizes: tuple[int, ...], state: int, inc: int, has_uint32: int, uinteger: int
) -> tuple[npt.NDArray[Any], Any]:
    """Return what is drawn from this state of PCG64, and the state after."""
    bits = np.random.PCG64()
    bits.state = {
        "bit_generator": "PCG64",
        "state": {"state": state, "inc": inc},
        "has_uint32": has_uint32,
        "uinteger": uinteger,
    }
    drawn = draw(np.random.Generator(bits), *sizes)
    drawn.flags.writeable = False
    return drawn, bits.state


def _percentiles(values: Array, confidence: float) -> Interval:
    low, high = central_range_in_place(values, confidence)
    return Interval(float(low), float(high))
