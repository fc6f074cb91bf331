"""Published bands of learning curves: where the mean of some more runs of the same agent lies.

A curve has seven figures: the mean return in each fifth of its budget, over the whole of it, and in its best fifth (an
agent that has learned may unlearn for a while). The band of each is the prediction interval of the mean of m new runs,
given n published ones: mean +- t s sqrt(1 / m + 1 / n), with Student's t of n - 1 degrees of freedom (Hahn and Meeker,
Statistical Intervals, 1991, section 4.8). The figures share an error of 1 % (Bonferroni): a sound agent is out of the
band in at most about 1 of 100 checks of a task.

Returns are not normal: most seeds of an agent may reach the best return early, and a few late. Ten seeds may hold none
of the late ones, and their deviation s is then much too small. So s is at least the root mean square of the deviations
of all agents on the task, which share a learner.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Final

import numpy as np

from sprl_bench.scores import Array
from sprl_bench.suggestions import unknown

CHANCE: Final = "random"  # does not learn
FIFTHS: Final = 5
FIGURES: Final = FIFTHS + 2
ERROR: Final = 0.01
NARROWEST: Final = 0.02  # half the width, where published runs hardly differ
FILE: Final = Path(__file__).with_name("bands.json")


@dataclass(frozen=True)
class Band:
    """Where the mean of some runs lies, figure by figure.

    Attributes:
        mean: Of the published runs, [7].
        low: Lower ends, [7].
        high: Upper ends, [7].
    """

    mean: Array
    low: Array
    high: Array

    def outside(self, figures: Array) -> dict[int, str]:
        """Return "below" or "above" for each of the figures [7], from 0, that lies outside."""
        below = {int(figure): "below" for figure in np.flatnonzero(figures < self.low)}
        return below | {int(figure): "above" for figure in np.flatnonzero(figures > self.high)}


def figures_of(curve: Sequence[float]) -> Array:
    """Return the means of the fifths of a curve of 100 bins, of all of it, and of its best fifth: [7]."""
    fifths = np.asarray(curve, dtype=np.float64).reshape(FIFTHS, -1).mean(axis=1)
    return np.array([*fifths, fifths.mean(), fifths.max()])


def band_of(published: Array, runs: int, least: Array | float = 0.0) -> Band:
    """Return the band of the mean of `runs` new runs.

    Args:
        published: The figures of each published run, [n, 7].
        runs: m, how many new runs there are.
        least: The smallest deviation of a run, of each figure, [7].
    """
    from scipy import stats  # noqa: PLC0415 - slow to load

    number = len(published)
    quantile = stats.t.ppf(1 - ERROR / (2 * published.shape[1]), number - 1)
    deviation = np.maximum(published.std(axis=0, ddof=1), least)
    half = quantile * deviation * np.sqrt(1 / runs + 1 / number)
    mean, half = published.mean(axis=0), np.maximum(half, NARROWEST)
    return Band(mean, mean - half, mean + half)


@cache
def published() -> Mapping[str, Any]:
    """Return the published runs: how they were made, and their figures by task and agent."""
    found: Mapping[str, Any] = json.loads(FILE.read_text(encoding="utf-8"))
    return found


def usual_deviation(task: str) -> Array:
    """Return the root mean square of the deviations of all agents that learn a task, of each figure, [7]."""
    of_agents = published()["figures"].get(task, {})
    variances = [np.var(runs, axis=0, ddof=1) for agent, runs in of_agents.items() if agent != CHANCE]
    return np.sqrt(np.mean(variances, axis=0)) if variances else np.zeros(FIGURES)


def published_figures(task: str, agent: str) -> Array | None:
    """Return the figures of an agent's published runs on a task, [n, 7]; None where it has none there.

    Raises:
        ValueError: No runs of the agent are published.
    """
    agents = sorted({name for of_task in published()["figures"].values() for name in of_task})
    if agent not in agents:
        raise ValueError(unknown("agent with a published band", agent, agents))
    runs = published()["figures"].get(task, {}).get(agent)
    return None if runs is None else np.asarray(runs, dtype=np.float64)
