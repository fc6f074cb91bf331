"""How much an agent depends on tuning: two numbers of the scores of all settings on all tasks.

The *sensitivity* is what is lost by one setting for all tasks against the best setting of each. The *effective
dimensionality* is how many hyperparameters have to be tuned for each task, while the others stay as they are in the
best setting for all, to keep 95 % of the best scores. Both are from Adkins et al. 2024, "A Method for Evaluating
Hyperparameter Sensitivity in Reinforcement Learning".
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from sprl_bench.scores import Array

KEPT = 0.95


@dataclass(frozen=True)
class Sensitivity:
    """How much an agent depends on tuning.

    Attributes:
        overall: Mean score of the setting that is best for all tasks.
        by_task: Mean score of the best setting of each task.
        dimensionality: How many hyperparameters have to be tuned for each task to keep 95 % of `by_task`.
        tuned: Which; of several such sets the one with the highest score.
    """

    overall: float
    by_task: float
    dimensionality: int
    tuned: tuple[str, ...]

    @property
    def loss(self) -> float:
        """What is lost by one setting for all tasks."""
        return self.by_task - self.overall


def sensitivity(scores: Array, values: Sequence[Mapping[str, Any]]) -> Sensitivity:
    """Compute both numbers.

    Args:
        scores: [H, T] of H settings on T tasks, such as mean AUCs over seeds; not negative.
        values: The hyperparameters of each setting, the same names in all. Where the settings are a sample of all
            combinations, a set of hyperparameters is tuned among those settings that agree in all others.
    """
    best = int(scores.mean(axis=1).argmax())
    overall, by_task = float(scores[best].mean()), float(scores.max(axis=0).mean())
    names = list(values[best])
    for size in range(len(names) + 1):
        tuned = {
            chosen: float(scores[_agreeing(values, best, chosen)].max(axis=0).mean())
            for chosen in itertools.combinations(names, size)
        }
        chosen = max(tuned, key=lambda names: tuned[names])
        if tuned[chosen] >= KEPT * by_task:
            return Sensitivity(overall, by_task, size, chosen)
    raise AssertionError("all hyperparameters together reach the best scores")


def _agreeing(values: Sequence[Mapping[str, Any]], best: int, tuned: Sequence[str]) -> list[int]:
    """Return the settings that agree with the best one in all hyperparameters but the tuned ones."""
    fixed = [name for name in values[best] if name not in tuned]
    return [place for place, own in enumerate(values) if all(own[name] == values[best][name] for name in fixed)]


def marginal(scores: Array, values: Sequence[Mapping[str, Any]], name: str) -> dict[Any, tuple[float, float]]:
    """Return the mean and the highest of the settings' scores [H] for each value of one hyperparameter."""
    found: dict[Any, list[float]] = {}
    for score, own in zip(scores.tolist(), values, strict=True):
        found.setdefault(own[name], []).append(score)
    return {value: (float(np.mean(its)), max(its)) for value, its in found.items()}
