"""Sensitivity by hand, after Adkins et al. 2024."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from sprl_bench.sweeps import sensitivity
from sprl_bench.sweeps.sensitivity import marginal

GRID = [{"a": a, "b": b} for a in (1, 2) for b in (1, 2)]


def test_one_setting_that_is_best_everywhere_needs_no_tuning() -> None:
    found = sensitivity(np.array([[0.9, 0.8], [0.1, 0.2], [0.0, 0.1], [0.3, 0.3]]), GRID)
    assert (found.overall, found.by_task, found.loss) == (pytest.approx(0.85), pytest.approx(0.85), 0)
    assert (found.dimensionality, found.tuned) == (0, ())


def test_one_hyperparameter_that_carries_it() -> None:
    """The tasks want different b; the best for both is the first, .6 on average, against .9 by task."""
    found = sensitivity(np.array([[0.9, 0.3], [0.2, 0.9], [0.5, 0.4], [0.1, 0.6]]), GRID)
    assert (found.overall, found.by_task) == (pytest.approx(0.6), pytest.approx(0.9))
    assert found.loss == pytest.approx(0.3)
    assert (found.dimensionality, found.tuned) == (1, ("b",))


def test_both_may_be_needed() -> None:
    found = sensitivity(np.array([[0.9, 0.2], [0.2, 0.1], [0.1, 0.2], [0.1, 0.9]]), GRID)
    assert (found.dimensionality, found.tuned) == (2, ("a", "b"))


@given(arrays(np.float64, (4, 3), elements=st.floats(0, 1)))
def test_tuning_never_loses(scores: np.ndarray) -> None:
    found = sensitivity(scores, GRID)
    assert found.loss + 1e-12 >= 0
    assert 0 <= found.dimensionality <= 2
    order = [2, 0, 3, 1]
    again = sensitivity(scores[order], [GRID[place] for place in order])
    assert (again.overall, again.by_task) == (pytest.approx(found.overall), pytest.approx(found.by_task))


def test_the_mean_and_the_best_of_each_value() -> None:
    assert marginal(np.array([0.9, 0.1, 0.5, 0.3]), GRID, "a") == {1: (0.5, 0.9), 2: (0.4, 0.5)}
