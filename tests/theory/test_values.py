"""Values against the enumeration of all policies, and against answers found by hand."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rewarded_worlds import all_policies, chancy_worlds

from sprl_bench import theory


def corridor(discount: float = 0.5) -> theory.RewardedWorld:
    """Three cells in a row, moves left and right; 1 for the last, which ends the episode."""
    table = np.array([[0, 1], [0, 2], [1, 2]])
    return theory.rewarded(theory.World(table, np.array([False, False, True]), 0), discount)


def test_a_corridor_by_hand() -> None:
    world = corridor()
    assert theory.best_values(world) == pytest.approx([0.5, 1.0, 0.0])
    assert theory.best_policy(world)[:2].tolist() == [[0.0, 1.0], [0.0, 1.0]]
    left = np.array([[1.0, 0.0]] * 3)
    assert theory.policy_values(world, left).tolist() == [0.0, 0.0, 0.0]
    coin = np.full((3, 2), 0.5)
    # v0 = (v0 + v1) / 4 and v1 = v0 / 4 + 1 / 2
    assert theory.policy_values(world, coin) == pytest.approx([2 / 11, 6 / 11, 0.0])


@settings(max_examples=200, deadline=None)
@given(chancy_worlds())
def test_no_policy_has_higher_values_and_the_optimal_one_has_these(world: theory.RewardedWorld) -> None:
    best = theory.best_values(world)
    values = np.array([theory.policy_values(world, policy) for policy in all_policies(world)])
    np.testing.assert_allclose(values.max(axis=0), best, atol=1e-8)
    np.testing.assert_allclose(theory.policy_values(world, theory.best_policy(world)), best, atol=1e-8)


@settings(max_examples=50, deadline=None)
@given(chancy_worlds(), st.integers(0, 10**6))
def test_values_are_sums_over_trajectories(world: theory.RewardedWorld, seed: int) -> None:
    """The sum over all trajectories of up to 6 steps, by enumeration, is at most discount^6 away."""
    policy = np.random.default_rng(seed).dirichlet(np.ones(world.num_actions), len(world.rewards))

    def value(state: int, depth: int) -> float:
        if world.ends[state] or not depth:
            return 0.0
        steps = itertools.product(range(world.num_actions), np.flatnonzero(world.transitions[state].any(axis=0)))
        return sum(
            policy[state, action]
            * world.transitions[state, action, after]
            * (world.rewards[after] + world.discount * value(int(after), depth - 1))
            for action, after in steps
        )

    left = world.discount**6 * np.abs(world.rewards).max() / (1 - world.discount)
    assert abs(value(world.start, 6) - theory.policy_values(world, policy)[world.start]) <= left + 1e-9


def test_what_is_refused() -> None:
    world = corridor()
    fields = {name: getattr(world, name) for name in ("transitions", "rewards", "ends", "start", "discount")}
    for changes, message in (
        ({"transitions": world.transitions[:, :, :2]}, r"transitions is \[3, 2, 2\]; it must be \[S, A, S\]"),
        ({"transitions": world.transitions * 0.5}, "transitions holds a row that is no distribution"),
        ({"rewards": np.array([0.0, np.nan, 1.0])}, "rewards is .*nan.*; it must be finite numbers"),
        ({"discount": 1.0}, "discount is 1.0; it must be above 0 and below 1"),
        ({"start": 3}, "start is 3; it must be an integer from 0 to 2"),
        ({"ends": np.zeros(2, np.bool_)}, "ends is"),
    ):
        with pytest.raises(ValueError, match=message):
            theory.RewardedWorld(**{**fields, **changes})
    for policy, message in (
        (np.ones((3, 2)), "policy holds a row that is no distribution"),
        (np.ones((3, 1)), "policy is"),
    ):
        with pytest.raises(ValueError, match=message):
            theory.policy_values(world, policy)
