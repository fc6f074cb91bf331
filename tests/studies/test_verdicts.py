"""Verdicts on made-up scores: the three outcomes, and how many seeds would decide."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sprl_bench.scores import Interval
from sprl_bench.studies.verdicts import Difference, all_above, best, combination, difference, nothing

HIGH, LOW, MIXED = np.array([0.7, 0.72, 0.74]), np.array([0.1, 0.12, 0.14]), np.array([0.0, 0.9, 0.8])


def test_a_difference_by_hand() -> None:
    one = difference("a minus b", [HIGH, HIGH], [LOW])
    assert one.value == pytest.approx(0.6)
    assert one.interval is not None
    assert 0.56 < one.interval.low < 0.6 < one.interval.high < 0.64
    assert (one.outcome, one.more_seeds, one.seeds) == ("supported", None, 3)
    assert difference("b minus a", [LOW], [HIGH]).outcome == "contradicted"
    assert difference("a minus c", [HIGH], [MIXED]).outcome == "not decided"


def test_a_weighted_sum_is_a_difference_of_differences() -> None:
    one = combination("gap", [(1.0, HIGH), (-1.0, LOW), (-1.0, LOW), (1.0, LOW)])
    assert one.value == pytest.approx(0.6)
    assert one.outcome == "supported"


def test_the_seeds_that_would_decide() -> None:
    """Half-width .2 at 4 seeds and a difference of .1: four times as many seeds halve the width."""
    one = Difference("d", 0.1, Interval(-0.1, 0.3), 4)
    assert one.more_seeds == 12
    assert Difference("d", 0.0, Interval(-0.1, 0.1), 4).more_seeds is None
    assert Difference("d", 0.1, None, 1).more_seeds is None
    verdict = all_above([one])
    assert verdict.sentence == (
        "Not decided: d: +0.100, [-0.100, 0.300]. "
        "If the differences stay as they are, about 12 more seeds would decide."
    )


def test_one_seed_decides_nothing() -> None:
    verdict = best("a", {"a": [HIGH[:1]], "b": [LOW[:1]]})
    assert verdict.outcome == "not decided"
    assert "no interval. One seed decides nothing" in verdict.sentence
    assert nothing("runs are missing").sentence == "Not decided: runs are missing."


def test_best_needs_all_and_one_that_is_better_contradicts() -> None:
    assert best("a", {"a": [HIGH], "b": [LOW], "c": [LOW]}).outcome == "supported"
    assert best("a", {"a": [HIGH], "b": [LOW], "c": [MIXED]}).outcome == "not decided"
    assert best("b", {"a": [HIGH], "b": [LOW], "c": [MIXED]}).outcome == "contradicted"


@given(st.lists(st.floats(0, 1), min_size=2, max_size=6), st.lists(st.floats(0, 1), min_size=2, max_size=6))
def test_the_claim_turned_round_has_the_verdict_turned_round(a: list[float], b: list[float]) -> None:
    turned = {"supported": "contradicted", "contradicted": "supported", "not decided": "not decided"}
    one = Difference("a - b", 1.0, difference("", [np.array(a)], [np.array(b)]).interval, 2)
    assert one.interval is not None
    other = Difference("b - a", -1.0, Interval(-one.interval.high, -one.interval.low), 2)
    assert other.outcome == turned[one.outcome]
