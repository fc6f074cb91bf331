"""Published bands of learning curves: where the mean of some more runs of the same agent lies.

A curve is cut into five parts of its budget. The band of each part is the prediction interval of the mean of m new
runs, given n published ones: mean +- t s sqrt(1 / m + 1 / n), with Student's t of n - 1 degrees of freedom (Hahn and
Meeker, Statistical Intervals, 1991, section 4.8). The parts share an error of 1 % (Bonferroni): a sound agent is out of
the band in at most about 1 of 100 checks of a task.
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

PARTS: Final = 5
ERROR: Final = 0.01
NARROWEST: Final = 0.02  # half the width, where published runs hardly differ; returns are between 0 and 1
FILE: Final = Path(__file__).with_name("bands.json")


@dataclass(frozen=True)
class Band:
    """Where the mean of some runs lies, part by part.

    Attributes:
        mean: Of the published runs, [5].
        low: Lower ends, [5].
        high: Upper ends, [5].
    """

    mean: Array
    low: Array
    high: Array

    def outside(self, parts: Array) -> dict[int, str]:
        """Return "below" or "above" for each part, from 0, in which the means [5] lie outside."""
        below = {int(part): "below" for part in np.flatnonzero(parts < self.low)}
        return below | {int(part): "above" for part in np.flatnonzero(parts > self.high)}


def parts_of(curve: Sequence[float]) -> Array:
    """Return the means of the five parts of a curve of 100 bins, [5]."""
    return np.asarray(curve, dtype=np.float64).reshape(PARTS, -1).mean(axis=1)


def band_of(published: Array, runs: int) -> Band:
    """Return the band of the mean of `runs` new runs.

    Args:
        published: The parts of each published run, [n, 5].
        runs: m, how many new runs there are.
    """
    from scipy import stats  # noqa: PLC0415 - slow to load

    number = len(published)
    quantile = stats.t.ppf(1 - ERROR / (2 * published.shape[1]), number - 1)
    half = quantile * published.std(axis=0, ddof=1) * np.sqrt(1 / runs + 1 / number)
    mean, half = published.mean(axis=0), np.maximum(half, NARROWEST)
    return Band(mean, mean - half, mean + half)


@cache
def published() -> Mapping[str, Any]:
    """Return the published runs: how they were made, and their parts by task and agent."""
    found: Mapping[str, Any] = json.loads(FILE.read_text(encoding="utf-8"))
    return found


def published_parts(task: str, agent: str) -> Array | None:
    """Return the parts of an agent's published runs on a task, [n, 5]; None where it has none there.

    Raises:
        ValueError: No runs of the agent are published.
    """
    agents = sorted({name for of_task in published()["parts"].values() for name in of_task})
    if agent not in agents:
        raise ValueError(unknown("agent with a published band", agent, agents))
    runs = published()["parts"][task].get(agent)
    return None if runs is None else np.asarray(runs, dtype=np.float64)
