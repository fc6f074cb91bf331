"""Scores against answers worked out by hand, and against slow, plain code."""

from __future__ import annotations

import statistics

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal
from scipy import stats

from sprl_bench import scores
from sprl_bench.quantiles import central_range_in_place

SCORES = np.asarray([[0.1, 0.5], [0.3, 0.9], [0.2, 0.1]])


def test_a_bin_is_the_mean_of_its_episodes_and_an_empty_one_repeats_the_last() -> None:
    curve = scores.curve([150, 160, 250], [1.0, 0.0, 0.25], budget=10_000)  # bins of 100 steps
    assert curve[0] == 0.0  # before the first episode
    assert curve[1] == 0.5  # steps 101 to 200
    assert_array_equal(curve[2:], np.full(98, 0.25))


def test_a_stamp_on_an_edge_belongs_to_the_bin_that_ends_there() -> None:
    curve = scores.curve([100, 101, 10_000], [1.0, 2.0, 3.0], budget=10_000)
    assert (curve[0], curve[1], curve[98], curve[99]) == (1.0, 2.0, 2.0, 3.0)


def test_episodes_beyond_the_budget_do_not_count() -> None:
    assert scores.curve([10_001], [1.0], budget=10_000).sum() == 0.0
    assert scores.curve([10_000, 10_001], [1.0, 5.0], budget=10_000)[99] == 1.0


def test_no_episodes_give_noughts() -> None:
    assert_array_equal(scores.curve([], [], budget=500), np.zeros(100))


def test_a_budget_need_not_divide_by_100() -> None:
    # Bin b is (2.5 b, 2.5 (b + 1)]: steps 1, 2 | 3, 4, 5 | 6, 7 | 8, 9, 10 | ...
    curve = scores.curve(np.arange(1, 251), np.arange(1, 251), budget=250)
    assert curve[:4].tolist() == [1.5, 4.0, 6.5, 9.0]
    assert curve[99] == 249.0  # 248, 249, 250


def test_a_budget_below_100_leaves_bins_empty() -> None:
    # Bin b is (b / 20, (b + 1) / 20]: step s ends bin 20 s - 1.
    curve = scores.curve([1, 5], [0.5, 1.0], budget=5)
    assert (curve[18], curve[19], curve[98], curve[99]) == (0.0, 0.5, 0.5, 1.0)


@settings(max_examples=50)
@given(
    budget=st.integers(1, 3_000),
    episodes=st.lists(st.tuples(st.integers(1, 3_200), st.floats(-1, 1)), max_size=60),
)
def test_bins_equal_those_of_a_plain_loop(budget: int, episodes: list[tuple[int, float]]) -> None:
    expected, last = [], 0.0
    for number in range(100):
        inside = [value for step, value in episodes if number * budget < 100 * step <= (number + 1) * budget]
        last = statistics.fmean(inside) if inside else last
        expected.append(last)
    stamps, values = [step for step, _ in episodes], [value for _, value in episodes]
    assert_allclose(scores.curve(stamps, values, budget), expected, rtol=1e-12, atol=1e-12)


def test_auc_final_and_threshold_of_a_ramp() -> None:
    ramp = np.arange(100) / 100
    assert scores.auc(ramp) == pytest.approx(0.495, abs=1e-15)
    assert scores.final(ramp) == pytest.approx(0.945, abs=1e-15)  # bins 90 to 99
    assert scores.steps_to_threshold(ramp, 20_000, (0.0, 1.0)) == 51 * 200  # bin 50 is the first of at least 0.5
    assert scores.steps_to_threshold(ramp, 20_000, (0.0, 1.8)) == 91 * 200
    assert scores.steps_to_threshold(ramp, 20_000, (0.0, 2.0)) is None


def test_the_threshold_is_half_of_the_range_wherever_the_range_lies() -> None:
    curve = np.concatenate([np.full(40, -30.0), np.full(60, -10.0)])
    assert scores.steps_to_threshold(curve, 1_000, (-40.0, 20.0)) == 410
    assert scores.steps_to_threshold(curve, 1_000, (-40.0, 30.0)) is None


def test_auc_does_not_depend_on_the_order_of_the_sum() -> None:
    curve = np.random.default_rng(0).random(100)
    assert scores.auc(curve) == scores.auc(curve[::-1]) == scores.auc(np.sort(curve))


def test_the_mean_is_over_seeds_and_then_over_tasks() -> None:
    assert float(scores.mean(SCORES)) == pytest.approx((0.2 + 0.5) / 2)


def test_the_interquartile_mean_leaves_out_a_quarter_on_each_side() -> None:
    assert float(scores.iqm(np.arange(8.0).reshape(4, 2))) == 3.5  # 2, 3, 4, 5
    assert float(scores.iqm(np.asarray([[0.0], [1.0], [2.0], [30.0]]))) == 1.5
    assert float(scores.iqm(np.asarray([[0.0], [1.0], [5.0]]))) == 2.0  # too few to leave one out
    # Six numbers: a quarter is one and a half, so one goes on each side, 0.1 and 0.9.
    assert float(scores.iqm(SCORES)) == pytest.approx((0.1 + 0.2 + 0.3 + 0.5) / 4)


@settings(max_examples=30)
@given(st.integers(1, 9), st.integers(1, 5), st.integers(0, 1_000))
def test_the_interquartile_mean_equals_scipys_trimmed_mean(seeds: int, tasks: int, seed: int) -> None:
    values = np.random.default_rng(seed).random((3, seeds, tasks))
    assert_allclose(scores.iqm(values), stats.trim_mean(values.reshape(3, -1), 0.25, axis=1), rtol=1e-12)


@pytest.mark.parametrize("statistic", [scores.mean, scores.iqm])
def test_a_statistic_of_many_samples_is_that_of_each(statistic: scores.Statistic) -> None:
    samples = np.random.default_rng(1).random((7, 5, 3))
    assert_allclose(statistic(samples), [float(statistic(sample)) for sample in samples], rtol=1e-14)


def test_the_same_generator_gives_the_same_interval() -> None:
    first, again, other = (
        scores.bootstrap_interval(SCORES, scores.mean, np.random.default_rng(seed), resamples=20) for seed in (3, 3, 4)
    )
    assert first == again != other


def test_a_single_seed_has_no_interval() -> None:
    generator = np.random.default_rng(0)
    assert scores.bootstrap_interval(SCORES[:1], scores.mean, generator) is None
    assert scores.difference_interval(SCORES[:1], SCORES, generator) is None
    assert scores.difference_interval(SCORES, SCORES[:1], generator) is None
    assert scores.curve_band(SCORES[:1], generator) is None


def test_equal_seeds_have_an_interval_without_width() -> None:
    values = np.tile([[0.25, 0.75]], (5, 1))
    interval = scores.bootstrap_interval(values, scores.mean, np.random.default_rng(0))
    assert interval == scores.Interval(0.5, 0.5)


def test_an_interval_of_two_seeds_by_enumeration() -> None:
    # Resampling {0, 1} gives means 0, 1/2 and 1 with probabilities 1/4, 1/2, 1/4: the outer 2.5 % are 0 and 1.
    values = np.asarray([[0.0], [1.0]])
    assert scores.bootstrap_interval(values, scores.mean, np.random.default_rng(0)) == scores.Interval(0.0, 1.0)
    inner = scores.bootstrap_interval(values, scores.mean, np.random.default_rng(0), confidence=0.4)
    assert inner == scores.Interval(0.5, 0.5)


def test_seeds_are_resampled_within_each_task_on_its_own() -> None:
    """Were whole rows drawn, these two tasks would always cancel and the interval would have no width."""
    values = np.asarray([[0.0, 1.0], [1.0, 0.0]])
    interval = scores.bootstrap_interval(values, scores.mean, np.random.default_rng(0))
    assert interval == scores.Interval(0.0, 1.0)  # each end has a probability of 1/16


def test_a_task_never_gets_the_scores_of_another() -> None:
    values = np.asarray([[0.0, 100.0], [1.0, 101.0], [2.0, 102.0]])
    low, high = scores.bootstrap_interval(
        values, lambda samples: samples[..., 1].min(axis=-1), np.random.default_rng(0), confidence=0.9999
    ) or (0.0, 0.0)
    assert (low, high) == (100.0, 102.0)


@pytest.mark.parametrize("statistic", [scores.mean, scores.iqm])
def test_the_interval_agrees_with_a_plain_bootstrap(statistic: scores.Statistic) -> None:
    values = np.random.default_rng(5).random((6, 3))
    generator = np.random.default_rng(6)
    resampled = []
    for _ in range(1_500):
        columns = [[column[seed] for seed in generator.integers(6, size=6)] for column in values.T]
        resampled.append(float(statistic(np.asarray(columns).T)))
    interval = scores.bootstrap_interval(values, statistic, np.random.default_rng(7))
    # The standard error of a quantile is sqrt(p (1 - p) / R) / density. For a normal statistic the density at 2.5 % is
    # 0.058 per deviation: 0.07 deviations with R = 1,500, 0.03 with 10,000. Four times both together is 0.3.
    assert interval is not None
    assert_allclose(interval, np.percentile(resampled, [2.5, 97.5]), atol=0.3 * float(np.std(resampled)))


def test_the_difference_is_of_the_same_tasks() -> None:
    with pytest.raises(ValueError, match="scores has 2 tasks and reference 1"):
        scores.difference_interval(SCORES, SCORES[:, :1], np.random.default_rng(0))


def test_the_difference_moves_with_the_scores() -> None:
    interval = scores.difference_interval(SCORES + 2.0, SCORES, np.random.default_rng(0))
    assert interval is not None
    assert interval.low < 2.0 < interval.high
    shifted = scores.difference_interval(SCORES + 3.0, SCORES, np.random.default_rng(0))
    assert shifted is not None
    assert_allclose(shifted, np.add(interval, 1.0), rtol=1e-12)


def test_the_two_sides_of_a_difference_are_resampled_independently() -> None:
    """With one stream for both, equal values would always give a difference of exactly nothing."""
    interval = scores.difference_interval(SCORES, SCORES, np.random.default_rng(0))
    assert interval is not None
    assert interval.low < 0.0 < interval.high


def test_an_interval_of_a_difference_by_enumeration() -> None:
    """Of 16 coins, as in the band below, on either side; and two tasks that would cancel if whole rows were drawn."""
    coins, fixed = np.repeat([[0.0], [1.0]], 8, axis=0), np.zeros((8, 1))
    generator = np.random.default_rng
    assert scores.difference_interval(coins, fixed, generator(0)) == scores.Interval(0.25, 0.75)
    assert scores.difference_interval(fixed, coins, generator(0)) == scores.Interval(-0.75, -0.25)
    opposite = np.asarray([[0.0, 1.0], [1.0, 0.0]])
    assert scores.difference_interval(np.zeros((2, 2)), opposite, generator(0)) == scores.Interval(-1.0, 0.0)


def test_a_band_holds_the_mean_curve_and_resamples_whole_runs() -> None:
    curves = np.random.default_rng(8).random((5, 100))
    band = scores.curve_band(curves, np.random.default_rng(9))
    assert band is not None
    low, high = band
    assert low.shape == high.shape == (100,)
    assert np.all((low < curves.mean(axis=0)) & (curves.mean(axis=0) < high))
    opposite = np.asarray([np.linspace(0, 1, 100), np.linspace(1, 0, 100)])
    band = scores.curve_band(opposite, np.random.default_rng(9))
    assert band is not None
    assert_allclose(band[0], np.minimum(*opposite))
    assert_allclose(band[1], np.maximum(*opposite))
    # The mean of 16 draws from {0, 1} is binomial: P(at most 3) = 0.011 and P(at most 4) = 0.038, so 4/16 and 12/16.
    coins = np.repeat([[0.0], [1.0]], 8, axis=0)
    band = scores.curve_band(coins, np.random.default_rng(9))
    assert band is not None
    assert (band[0].item(), band[1].item()) == (0.25, 0.75)


# 95 % percentile intervals by rliable 1.2.0 (with arch 7.2.0, numpy 2.4.6, scipy 1.17.1, pandas 2.3.3, Python 3.11.7):
# get_interval_estimates of aggregate_mean and aggregate_iqm, the average of several calls with 20,000 resamples each.
RLIABLE = {
    "uneven": (
        [
            [0.12, 0.55, 0.91, 0.03],
            [0.20, 0.61, 0.88, 0.00],
            [0.16, 0.20, 0.93, 0.41],
            [0.35, 0.58, 0.90, 0.02],
            [0.11, 0.66, 0.47, 0.05],
        ],
        {"mean": (0.407, 0.3392, 0.4704), "iqm": (0.365, 0.2678, 0.4590)},
    ),
    "even": (
        [
            [0.10, 0.35, 0.81, 0.00],
            [0.14, 0.31, 0.78, 0.00],
            [0.12, 0.40, 0.83, 0.10],
            [0.15, 0.28, 0.80, 0.02],
            [0.11, 0.36, 0.77, 0.01],
            [0.09, 0.30, 0.79, 0.00],
        ],
        {"mean": (0.3175, 0.3058, 0.3304), "iqm": (0.22667, 0.2083, 0.2447)},
    ),
}


@pytest.mark.parametrize("name", ["mean", "iqm"])
@pytest.mark.parametrize("matrix", RLIABLE)
def test_values_and_intervals_agree_with_rliable(matrix: str, name: str) -> None:
    rows, expected = RLIABLE[matrix]
    value, low, high = expected[name]
    values, statistic = np.asarray(rows), {"mean": scores.mean, "iqm": scores.iqm}[name]
    assert float(statistic(values)) == pytest.approx(value, abs=1e-5)
    interval = scores.bootstrap_interval(values, statistic, np.random.default_rng(11))
    # From call to call with 20,000 resamples they moved by up to 0.7 % of the width, so with 10,000 by 1 %
    # (standard deviations): 5 % is far outside of that.
    assert interval is not None
    assert_allclose(interval, (low, high), atol=0.05 * (high - low))


def test_shared_draws_are_those_of_the_generator_and_move_it_on() -> None:
    """A second interval from the same state is the same; from the state after it, what a fresh generator would give."""
    values = np.random.default_rng(0).random((4, 3))
    generator = np.random.default_rng(7)
    plain = np.random.Generator(np.random.MT19937(7))  # of another kind: never remembered
    first, second = (scores.bootstrap_interval(values, scores.mean, generator) for _ in range(2))
    assert first == scores.bootstrap_interval(values, scores.mean, np.random.default_rng(7))
    assert first != second
    fresh = np.random.default_rng(7)
    chosen = fresh.integers(4, size=(10_000, 4, 3))
    means = np.take_along_axis(values[None], chosen, axis=1).mean(axis=1).mean(axis=1)
    assert first == pytest.approx(tuple(np.percentile(means, [2.5, 97.5])), abs=0)
    assert fresh.bit_generator.state == _state_after(values, np.random.default_rng(7))
    assert scores.bootstrap_interval(values, scores.mean, plain) is not None


def _state_after(values: scores.Array, generator: np.random.Generator) -> object:
    scores.bootstrap_interval(values, scores.mean, generator)
    return generator.bit_generator.state


@given(st.integers(2, 300), st.floats(0.01, 0.99), st.integers(0, 2**32 - 1))
def test_a_central_range_in_place_is_numpys_to_the_last_bit(samples: int, confidence: float, seed: int) -> None:
    generator = np.random.default_rng(seed)
    for values in (generator.random((3, samples)), generator.integers(0, 3, (3, samples)) / 7):
        tail = 100 * (1 - confidence) / 2
        expected = np.percentile(values, [tail, 100 - tail], axis=-1)
        assert np.array_equal(central_range_in_place(values.copy(), confidence), expected)


@pytest.mark.parametrize("statistic", [scores.mean, scores.iqm])
def test_resampling_in_parts_changes_nothing(statistic: scores.Statistic, monkeypatch: pytest.MonkeyPatch) -> None:
    matrix, curves = np.random.default_rng(0).random((9, 20)), np.random.default_rng(1).random((9, 100))

    def intervals() -> list[object]:
        whole = scores.bootstrap_interval(matrix, statistic, np.random.default_rng(2))
        band = scores.curve_band(curves, np.random.default_rng(2))
        assert band is not None
        return [whole, *(end.tolist() for end in band)]

    in_parts = intervals()
    monkeypatch.setattr(scores, "PART", 10**9)
    assert intervals() == in_parts
