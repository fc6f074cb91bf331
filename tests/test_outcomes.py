"""Shares and censored times against answers worked out by hand, and against scipy's."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from sprl_bench.outcomes import first_goal, kaplan_meier, median_time, wilson_interval

BUDGET = 1_000
TIME = st.integers(1, BUDGET)


def test_wilson_by_hand() -> None:
    # Of five, all: the lower end is n / (n + z^2) with z = 1.96.
    assert wilson_interval(5, 5) == pytest.approx((5 / (5 + 1.959964**2), 1.0))
    assert wilson_interval(0, 5) == pytest.approx((0.0, 1.959964**2 / (5 + 1.959964**2)))
    with pytest.raises(ValueError, match="successes is 3 of 2"):
        wilson_interval(3, 2)


@given(st.integers(1, 30).flatmap(lambda total: st.tuples(st.integers(0, total), st.just(total))))
def test_wilson_is_scipys_and_holds_the_share(counts: tuple[int, int]) -> None:
    interval = wilson_interval(*counts)
    expected = stats.binomtest(*counts).proportion_ci(0.95, "wilson")
    assert interval == pytest.approx((expected.low, expected.high), abs=1e-12)
    assert interval.low <= counts[0] / counts[1] <= interval.high
    mirrored = wilson_interval(counts[1] - counts[0], counts[1])
    assert mirrored == pytest.approx((1 - interval.high, 1 - interval.low))


def test_the_first_goal_is_at_the_end_of_its_bin() -> None:
    assert first_goal([0.0] * 4 + [0.1] + [0.0] * 95, BUDGET) == 50
    assert first_goal([1.0] * 100, BUDGET) == 10
    assert first_goal([0.0] * 100, BUDGET) is None


@given(st.lists(TIME, min_size=1, max_size=20))
def test_without_censoring_the_curve_is_the_plain_share(times: list[int]) -> None:
    at, left = kaplan_meier(times, BUDGET)
    for time, share in zip(at, left, strict=True):
        assert share == pytest.approx(np.mean(np.array(times) > time))
    # Half have reached it at the lower median.
    assert median_time(times, BUDGET).median == sorted(times)[(len(times) - 1) // 2]


@given(st.lists(TIME, max_size=12), st.integers(1, 12))
def test_censoring_at_the_budget_leaves_the_share_before_it_as_it_is(times: list[int], censored: int) -> None:
    early = [time for time in times if time < BUDGET]
    runs = [*early, *[None] * censored]
    at, left = kaplan_meier(runs, BUDGET)
    for time, share in zip(at, left, strict=True):
        assert share == pytest.approx((sum(one > time for one in early) + censored) / len(runs))
    found = median_time(runs, BUDGET)
    assert (found.reached, found.total) == (len(early), len(runs))
    assert (found.median is None) == (len(early) < len(runs) / 2)


def test_a_run_that_never_reached_the_goal_is_later_than_the_budget_and_not_at_it() -> None:
    found = median_time([100, None, None], BUDGET)
    assert (found.median, found.high, found.reached) == (None, None, 1)
    assert median_time([100, 100], BUDGET) == (100, 100, None, 2, 2)  # two runs do not bound a median from above
    assert median_time([None, None], BUDGET) == (None, None, None, 0, 2)
    with pytest.raises(ValueError, match="times is empty"):
        median_time([], BUDGET)


def test_a_median_by_hand_with_its_interval() -> None:
    times = list(range(100, 1_100, 100))
    found = median_time(times, BUDGET)
    assert found.median == 500
    # The log-log band of ten runs holds one half from 200 to 700.
    survival = 1 - np.arange(1, 10) / 10
    deviation = np.sqrt((1 - survival) / (10 * survival)) / np.abs(np.log(survival))
    low, high = (survival ** np.exp(sign * 1.959964 * deviation) for sign in (1, -1))
    assert found.low == 100 * (1 + np.flatnonzero(low <= 0.5)[0])
    assert found.high == 100 * (1 + np.flatnonzero(high <= 0.5)[0])


@pytest.mark.parametrize("total", [5, 10])
def test_an_interval_holds_the_median_in_95_of_100_cases_or_more(total: int) -> None:
    drawn, held = np.random.default_rng(0), 0
    for _ in range(300):
        times = (drawn.exponential(500, total) + 1).astype(int)
        found = median_time([None if time > BUDGET else int(time) for time in times], BUDGET)
        low, high = found.low or np.inf, found.high or np.inf
        held += low <= 500 * np.log(2) + 1 <= high
    assert held / 300 > 0.92
