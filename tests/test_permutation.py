"""The permutation test against answers counted by hand, against scipy's, and under its null hypothesis."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from sprl_bench import permutation, scores
from sprl_bench.permutation import permutation_p

SCORE = st.floats(0, 1, width=16)


def generator(seed: int = 0) -> np.random.Generator:
    return np.random.default_rng(seed)


def column(*values: float) -> scores.Array:
    return np.array(values)[:, None]


def test_p_values_counted_by_hand() -> None:
    # Of the 20 ways to choose three of six, only the observed one and its mirror are as far apart.
    assert permutation_p(column(4, 5, 6), column(1, 2, 3), generator()) == 2 / 20
    assert permutation_p(column(1, 2, 3), column(4, 5, 6), generator()) == 2 / 20
    assert permutation_p(column(1), column(0), generator()) == 1.0  # one seed each decides nothing
    assert permutation_p(column(9), column(0, 1, 2, 3), generator()) == 1 / 5
    assert permutation_p(column(1, 1), column(1, 1, 1), generator()) == 1.0


def test_tasks_are_relabelled_on_their_own() -> None:
    ours, theirs = np.array([[4, 40], [5, 50], [6, 60]]), np.array([[1, 10], [2, 20], [3, 30]])
    assert permutation_p(ours, theirs, generator()) == 2 / 20**2
    # Better on one task by as much as worse on the other: the mean says nothing.
    assert permutation_p(np.array([[1.0, 0], [1, 0]]), np.array([[0.0, 1], [0, 1]]), generator()) == 1.0


@settings(max_examples=25)
@given(st.lists(SCORE, min_size=2, max_size=5), st.lists(SCORE, min_size=2, max_size=5))
def test_one_task_gives_the_p_value_of_scipy(ours: list[float], theirs: list[float]) -> None:
    expected = stats.permutation_test(
        (ours, theirs), lambda a, b, axis: a.mean(axis) - b.mean(axis), n_resamples=np.inf, vectorized=True
    )
    p_value = permutation_p(column(*ours), column(*theirs), generator())
    # scipy doubles the smaller tail; where both tails are equal in size that is ours.
    if len(ours) == len(theirs):
        assert p_value == pytest.approx(min(expected.pvalue, 1.0))
    assert 0 < p_value <= 1


@settings(max_examples=30)
@given(st.lists(st.tuples(SCORE, SCORE), min_size=4, max_size=8), st.integers(1, 3))
def test_the_order_of_the_sides_and_their_place_do_not_matter(rows: list[tuple[float, float]], cut: int) -> None:
    ours, theirs = np.array(rows[:cut]), np.array(rows[cut:])
    there, back = permutation_p(ours, theirs, generator()), permutation_p(theirs, ours, generator())
    assert there == back == permutation_p(ours + 4, theirs + 4, generator())
    assert there == permutation_p(ours[::-1], theirs[::-1], generator())


def test_drawn_relabellings_agree_with_all(monkeypatch: pytest.MonkeyPatch) -> None:
    ours, theirs = generator(1).random((5, 2)) + 0.15, generator(2).random((5, 2))
    for statistic in (scores.mean, scores.iqm):
        exact = permutation_p(ours, theirs, generator(), statistic=statistic)
        with monkeypatch.context() as patch:
            patch.setattr(permutation, "EXACT", 0)
            drawn = [permutation_p(ours, theirs, generator(seed), statistic=statistic) for seed in (3, 3)]
        assert drawn[0] == drawn[1] == pytest.approx(exact, abs=0.015)


def test_many_runs_are_drawn_and_never_give_nought() -> None:
    ours, theirs = np.ones((12, 3)) + generator(0).random((12, 3)), generator(1).random((12, 3))
    assert permutation_p(ours, theirs, generator(), resamples=500) == 1 / 501


@pytest.mark.parametrize(("ours", "theirs", "tasks"), [(3, 3, 1), (4, 3, 1), (3, 2, 2), (8, 8, 2)])
def test_p_values_are_uniform_or_larger_where_there_is_no_difference(ours: int, theirs: int, tasks: int) -> None:
    drawn = generator(0)
    p_values = [
        permutation_p(drawn.gamma(0.5, size=(ours, tasks)), drawn.gamma(0.5, size=(theirs, tasks)), drawn, resamples=99)
        for _ in range(600)
    ]
    for level in (0.05, 0.1, 0.25, 0.5):
        share = np.mean(np.array(p_values) <= level)
        assert share <= level + 3 * np.sqrt(level * (1 - level) / 600), (level, share)


def test_a_larger_difference_has_a_smaller_p_value() -> None:
    ours, theirs = generator(0).random((4, 1)), generator(1).random((5, 1))
    ours += theirs.mean() - ours.mean()
    p_values = [permutation_p(ours + shift, theirs, generator()) for shift in (0.0, 0.3, 0.6, 1.5)]
    assert p_values[0] == 1
    assert all(later <= earlier for earlier, later in pairwise(p_values))
    assert p_values[-1] == 1 / 126  # that all of ours are above: 9 over 4 ways, and no mirror with unequal numbers


def test_sides_without_the_same_tasks_are_refused() -> None:
    with pytest.raises(ValueError, match="scores has 2 tasks and reference 1"):
        permutation_p(np.ones((2, 2)), np.ones((2, 1)), generator())
