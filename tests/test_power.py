"""Power and the sequential rule: known answers, growth with seeds, and errors where there is no difference."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from sprl_bench import scores
from sprl_bench.power import power, seeds_needed, spread_out
from sprl_bench.sequential import boundary, decide, looks_to_decide, statistics


def generator(seed: int = 0) -> np.random.Generator:
    return np.random.default_rng(seed)


def normal(seeds: int, mean: float, tasks: int = 1) -> scores.Array:
    """Scores [seeds, tasks] whose quantiles are those of a normal distribution with this mean and deviation 1."""
    quantiles = stats.norm.ppf((np.arange(seeds) + 0.5) / seeds)
    exact = mean + (quantiles - quantiles.mean()) / quantiles.std(ddof=1)
    return np.tile(exact[:, None], tasks)


def test_the_spread_becomes_unbiased_and_the_mean_stays() -> None:
    few = generator().random((5, 2))
    assert spread_out(few).mean(axis=0) == pytest.approx(few.mean(axis=0))
    assert spread_out(few).var(axis=0) == pytest.approx(few.var(axis=0, ddof=1))
    with pytest.raises(ValueError, match="single seed"):
        spread_out(few[:1])


@pytest.mark.parametrize(("seeds", "difference"), [(10, 1.0), (17, 1.0), (26, 0.8)])
def test_power_is_about_that_of_a_t_test(seeds: int, difference: float) -> None:
    freedom, shift = 2 * seeds - 2, difference * np.sqrt(seeds / 2)
    expected = stats.nct.sf(stats.t.ppf(0.975, freedom), freedom, shift)
    found = power(normal(40, difference), normal(40, 0.0), (seeds, seeds), generator())
    assert found == pytest.approx(expected, abs=0.07)


def test_without_a_difference_power_is_alpha() -> None:
    assert power(normal(20, 0.0), normal(20, 0.0), (8, 8), generator()) == pytest.approx(0.05, abs=0.035)


@pytest.mark.parametrize("tasks", [1, 3])
def test_power_rises_with_seeds_and_with_tasks(tasks: int) -> None:
    ours, theirs = normal(10, 0.7, tasks), normal(10, 0.0, tasks)
    powers = [power(ours, theirs, (seeds, seeds), generator()) for seeds in (3, 8, 20, 50)]
    assert powers == sorted(powers)
    assert powers[-1] > 0.9
    assert power(normal(10, 0.7, 4), normal(10, 0.0, 4), (8, 8), generator()) > powers[1]


def test_the_number_of_seeds_has_the_power_and_fewer_do_not() -> None:
    ours, theirs = normal(10, 1.0), normal(10, 0.0)
    needed = seeds_needed(ours, theirs, 0, both=True)
    assert needed == pytest.approx(17, abs=4)  # the t test's
    assert needed is not None
    assert power(ours, theirs, (needed, needed), generator()) >= 0.8
    assert power(ours, theirs, (needed - 1, needed - 1), generator()) < 0.8
    alone = seeds_needed(ours, theirs, 0)
    assert alone is not None
    assert alone > needed


def test_a_clear_difference_needs_no_more_seeds_and_none_is_never_found() -> None:
    ours = normal(5, 0.0)
    assert seeds_needed(ours + 9, ours, 0) == 5
    assert seeds_needed(ours, ours, 0) is None


def test_the_statistic_by_hand() -> None:
    # Wins of the two against 1, 2, 3: 3, then 1 and a half of a tie.
    path = statistics(np.array([[9.0], [2.0]]), np.array([[1.0], [2.0], [3.0]]))
    assert path == pytest.approx([(3 - 1.5) / np.sqrt(3 * 5 / 12), (4.5 - 3) / np.sqrt(6 * 6 / 12)])


@settings(max_examples=25)
@given(st.integers(2, 8), st.integers(2, 8), st.integers(0, 99))
def test_it_is_the_mann_whitney_statistic_and_the_probability_of_improvement(ours: int, others: int, seed: int) -> None:
    drawn = generator(seed)
    mine, theirs = drawn.random((ours, 1)), drawn.random((others, 1))
    expected = stats.mannwhitneyu(mine[:, 0], theirs[:, 0], method="asymptotic", use_continuity=False)
    last = statistics(mine, theirs)[-1]
    assert 2 * stats.norm.sf(abs(last)) == pytest.approx(expected.pvalue)
    half = (scores.probability_of_improvement(mine, theirs) - 0.5) * ours * others
    assert last * np.sqrt(ours * others * (ours + others + 1) / 12) == pytest.approx(half)


@pytest.mark.parametrize(("others", "tasks", "looks"), [(5, 1, 30), (5, 4, 10), (10, 2, 20)])
@pytest.mark.parametrize("kind", ["skewed", "tied"])
def test_looking_after_each_seed_decides_wrongly_in_at_most_5_of_100_cases(
    others: int, tasks: int, looks: int, kind: str
) -> None:
    drawn = generator(1)
    make = (
        (lambda *size: drawn.gamma(0.3, size=size))
        if kind == "skewed"
        else (lambda *size: drawn.integers(3, size=size))
    )
    paths = statistics(make(2_000, looks, tasks), make(2_000, others, tasks))
    wrong = np.mean((np.abs(paths) >= boundary(others, tasks, looks)).any(axis=1))
    assert wrong <= 0.05 + 3 * np.sqrt(0.05 * 0.95 / 2_000)
    if kind == "skewed":
        assert wrong > 0.02  # and not for want of power


def test_looking_again_and_again_at_the_plain_test_does_not_keep_its_word() -> None:
    """Why the rule is needed."""
    drawn = generator(2)
    paths = statistics(drawn.random((2_000, 30, 1)), drawn.random((2_000, 5, 1)))
    assert (np.abs(paths) >= stats.norm.ppf(0.975)).any(axis=1).mean() > 0.1


def test_a_clear_difference_is_decided_soon_and_its_side_is_named() -> None:
    theirs, ours = generator(0).random((5, 2)), generator(1).random((12, 2))
    found = decide(ours + 2, theirs)
    assert found.look is not None
    assert found.look <= 5
    assert (found.better, decide(ours - 2, theirs).better) == (True, False)
    assert decide(ours, theirs).look is None
    with pytest.raises(ValueError, match="looks is 0"):
        decide(ours, theirs, looks=0)


def test_a_decision_is_not_taken_back_by_later_seeds() -> None:
    theirs = generator(0).random((5, 1))
    ours = np.concatenate([generator(1).random((6, 1)) + 2, generator(2).random((10, 1)) - 2])
    assert decide(ours, theirs).look == decide(ours[:6], theirs).look


def test_more_looks_ask_for_more_at_each() -> None:
    values = [boundary(5, 2, looks) for looks in (2, 10, 30)]
    assert values == sorted(values)
    assert values[0] > stats.norm.ppf(0.975) * 0.9


def test_continuations_of_a_difference_are_decided_and_of_none_are_not() -> None:
    theirs = normal(5, 0.0, 2)
    found = looks_to_decide(normal(3, 3.0, 2), theirs)
    assert found is not None
    assert found <= 12
    assert looks_to_decide(theirs, theirs) is None
