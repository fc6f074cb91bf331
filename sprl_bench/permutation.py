"""The stratified permutation test: are the scores of two methods distinguishable?

If both methods were the same, then on each task the labels of their runs could be exchanged. The p-value is the share
of all relabellings, within each task, whose difference is at least as large as the observed one (Good, Permutation,
Parametric, and Bootstrap Tests of Hypotheses, 2005, chapters 3 and 6). No distribution is assumed, so five seeds are
enough for a valid p-value.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations, product
from math import comb
from typing import Final

import numpy as np
import numpy.typing as npt

from sprl_bench.scores import Array, Statistic, mean

EXACT: Final = 100_000
"""The most relabellings that are all counted; where there are more, as many as `resamples` are drawn."""
CHUNK: Final = 20_000  # relabellings computed at once
ROUNDING: Final = 1e-9  # of the scores' spread: differences closer than this are equal

Indices = npt.NDArray[np.int64]


def permutation_p(
    scores: Array,
    reference: Array,
    generator: np.random.Generator,
    *,
    statistic: Statistic = mean,
    resamples: int = 10_000,
) -> float:
    """Return the two-sided p-value of statistic(scores) - statistic(reference).

    It is exact where there are at most `EXACT` relabellings. Else it is (1 + h) / (1 + resamples), where h of the drawn
    relabellings have a difference at least as large; this is valid, too (Phipson and Smyth, 2010).

    Args:
        scores: [S, T].
        reference: [S', T], the same tasks in the same order.
        generator: The same generator state gives the same p-value; an exact one does not use it.
        statistic: From [R, S, T] to [R].
        resamples: How many relabellings are drawn where there are too many to count.

    Raises:
        ValueError: The two do not have the same number of tasks.
    """
    if scores.shape[1] != reference.shape[1]:
        raise ValueError(f"scores has {scores.shape[1]} tasks and reference {reference.shape[1]}; they must be paired.")
    pooled, seeds = np.concatenate([scores, reference]), len(scores)
    runs, tasks = pooled.shape
    observed = float(statistic(scores) - statistic(reference))
    least = abs(observed) - ROUNDING * float(np.ptp(pooled))
    exact = comb(runs, seeds) ** tasks <= EXACT
    orders = _all_orders(runs, tasks, seeds) if exact else _drawn_orders(runs, tasks, generator, resamples)
    extreme = total = 0
    for chunk in orders:
        relabelled = np.take_along_axis(pooled[None], chunk, axis=1)
        differences = statistic(relabelled[:, :seeds]) - statistic(relabelled[:, seeds:])
        extreme += int(np.count_nonzero(np.abs(differences) >= least))
        total += len(chunk)
    return extreme / total if exact else (1 + extreme) / (1 + total)


def _all_orders(runs: int, tasks: int, seeds: int) -> Iterator[Indices]:
    """Yield, in parts [R, runs, T], an order of the runs for every choice of `seeds` runs on each task."""
    splits = np.array([(*chosen, *sorted({*range(runs)} - {*chosen})) for chosen in combinations(range(runs), seeds)])
    chosen = np.array(list(product(range(len(splits)), repeat=tasks)))
    for start in range(0, len(chosen), CHUNK):
        yield np.moveaxis(splits[chosen[start : start + CHUNK]], 1, 2)


def _drawn_orders(runs: int, tasks: int, generator: np.random.Generator, resamples: int) -> Iterator[Indices]:
    """Yield, in parts [R, runs, T], random orders of the runs, drawn for each task on its own."""
    for start in range(0, resamples, CHUNK):
        yield generator.random((min(CHUNK, resamples - start), runs, tasks)).argsort(axis=1)
