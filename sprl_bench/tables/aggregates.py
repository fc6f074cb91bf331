"""Comparisons of agents over a whole suite: performance profiles and the probability of improvement.

Agarwal et al., Deep RL at the Edge of the Statistical Precipice, 2021, sections 4.2 and 4.3.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final, NamedTuple

import numpy as np

from sprl_bench import scores
from sprl_bench.tables.seed_results import Result
from sprl_bench.tables.table import BOOTSTRAP_SEED, Table

THRESHOLDS: Final = 51


class Improvement(NamedTuple):
    """How probably a run of an agent scores higher than one of another; the interval is None for a single seed."""

    agent: str
    reference: str
    value: float
    interval: scores.Interval | None

    @property
    def opposite(self) -> Improvement:
        """The other direction, whose probability is the rest."""
        interval = scores.Interval(1 - self.interval.high, 1 - self.interval.low) if self.interval else None
        return Improvement(self.reference, self.agent, 1 - self.value, interval)


def matrices_of(results: Sequence[Result], table: Table) -> dict[str, scores.Array]:
    """Return the AUCs of each agent, [S, T], over the seeds that it has on every task; agents without one are left out.

    AUCs are shares of their task's score range.
    """
    found = {(result.agent, result.task.name, result.seed): _share(result) for result in results}
    return {
        row.agent: np.asarray([[found[row.agent, task, seed] for task in table.tasks] for seed in row.seeds])
        for row in table.rows
        if row.seeds
    }


def _share(result: Result) -> float:
    low, high = result.task.score_range
    return (result.scores.auc - low) / (high - low)


def improvement_of(agent: str, reference: str, matrices: Mapping[str, scores.Array]) -> Improvement:
    """Return the probability that an agent improves on another, with its interval."""
    ours, theirs = matrices[agent], matrices[reference]
    value = scores.probability_of_improvement(ours, theirs)
    interval = scores.improvement_interval(ours, theirs, np.random.default_rng(BOOTSTRAP_SEED))
    return Improvement(agent, reference, value, interval)


def profile_of(matrix: scores.Array) -> tuple[scores.Array, scores.Array]:
    """Return thresholds from 0 to 1 and the share of runs above each: both [51]."""
    thresholds = np.linspace(0, 1, THRESHOLDS)
    return thresholds, scores.performance_profile(matrix, thresholds)
