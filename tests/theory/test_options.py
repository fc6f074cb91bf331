"""Masses, chances and pi-distances against sums over paths, and Theorem 1 against all policies."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from rewarded_worlds import all_policies, certain_worlds, chancy_worlds, staged_worlds

from sprl_bench import theory
from sprl_bench.theory.options import TOLERANCE
from sprl_bench.theory.values import Floats

SEEDS = st.integers(0, 10**6)


def random_policy(world: theory.RewardedWorld, seed: int) -> Floats:
    return np.random.default_rng(seed).dirichlet(np.full(world.num_actions, 0.5), len(world.rewards))


def summed_paths(world: theory.RewardedWorld, policy: Floats, target: int, discount: float) -> Floats:
    """Sum probability times discount^length over all paths to a target, length by length, [S]."""
    moves = theory.policy_transitions(world, policy)
    stops = world.rewarding | world.ends | (np.arange(len(moves)) == target)
    here, total = np.eye(len(moves)), np.zeros(len(moves))
    for length in range(1, 150):
        here = here @ moves
        total += discount**length * here[:, target]
        here[:, stops] = 0.0
    return total


@settings(max_examples=200, deadline=None)
@given(chancy_worlds(), SEEDS)
def test_masses_and_chances_are_sums_over_paths(world: theory.RewardedWorld, seed: int) -> None:
    policy = random_policy(world, seed)
    masses, chances = theory.transition_masses(world, policy), theory.path_chances(world, policy)
    for target in range(len(world.rewards)):
        np.testing.assert_allclose(masses[:, target], summed_paths(world, policy, target, world.discount), atol=1e-9)
        # a chance is approached slowly where a policy circles for long; it is never more
        assert (summed_paths(world, policy, target, 1.0) <= chances[:, target] + 1e-9).all()
    assert (chances <= 1 + 1e-9).all()
    assert (masses <= chances * world.discount + 1e-9).all()


@settings(max_examples=200, deadline=None)
@given(chancy_worlds(), SEEDS)
def test_values_follow_from_the_masses_of_rewarding_states(world: theory.RewardedWorld, seed: int) -> None:
    """V(s) is the sum over rewarding s' of mass(s, s') times (reward + discount V(s')) / discount."""
    policy = random_policy(world, seed)
    values = theory.policy_values(world, policy)
    worth = np.where(world.rewarding, world.rewards / world.discount + values, 0.0)
    np.testing.assert_allclose(theory.transition_masses(world, policy) @ worth, values, atol=1e-8)


@settings(max_examples=200, deadline=None)
@given(chancy_worlds())
def test_the_highest_masses_are_those_of_the_best_policies(world: theory.RewardedWorld) -> None:
    masses = np.array([theory.transition_masses(world, policy) for policy in all_policies(world)])
    np.testing.assert_allclose(masses.max(axis=0), theory.best_masses(world), atol=1e-8)


@settings(max_examples=200, deadline=None)
@given(certain_worlds(), SEEDS)
def test_in_a_deterministic_world_distances_are_lengths(world: theory.RewardedWorld, seed: int) -> None:
    actions = np.random.default_rng(seed).integers(0, world.num_actions, len(world.rewards))
    policy = np.eye(world.num_actions)[actions]
    found = theory.policy_distances(world, policy)
    for start in range(len(world.rewards)):
        lengths = np.full(len(world.rewards), np.inf)
        state = start
        for length in range(1, 2 * len(world.rewards)):
            if world.ends[state]:
                break
            state = int(world.transitions[state, actions[state]].argmax())
            lengths[state] = min(lengths[state], length)
            if world.rewarding[state]:
                break
        np.testing.assert_allclose(found[start], lengths)


@settings(max_examples=200, deadline=None)
@given(certain_worlds())
def test_an_optimal_policy_satisfies_the_constraint(world: theory.RewardedWorld) -> None:
    """Theorem 1, deterministic, positive rewards; the first way to a reward is a shortest one, by search."""
    policy = theory.best_policy(world)
    assert theory.satisfies_constraint(world, policy)
    successors = world.transitions.argmax(axis=2)
    table = theory.distances(theory.World(successors, world.rewarding | world.ends, world.start))
    state, way = world.start, [world.start]
    for _ in range(20):
        state = int(world.transitions[state, policy[state].argmax()].argmax())
        way.append(state)
        if world.rewarding[state]:
            if not world.rewarding[way[0]]:
                assert theory.is_admissible(way, table, k=len(way))
            return


@settings(max_examples=200, deadline=None)
@given(certain_worlds())
def test_the_constraint_by_enumeration(world: theory.RewardedWorld) -> None:
    """A policy satisfies it if and only if no other policy reaches the same next reward in fewer steps."""
    policies = list(all_policies(world))[:: max(1, world.num_actions ** len(world.rewards) // 20)]
    shortest = np.min([theory.policy_distances(world, policy) for policy in all_policies(world)], axis=0)
    for policy in policies:
        own = theory.policy_distances(world, policy)
        pairs = np.isfinite(own) & world.rewarding & theory.visited(world, policy)[:, None]
        assert theory.satisfies_constraint(world, policy) is bool((own <= shortest + 1e-6)[pairs].all())


@settings(max_examples=300, deadline=None)
@given(staged_worlds())
def test_an_optimal_policy_satisfies_the_constraint_under_mild_chance(world: theory.RewardedWorld) -> None:
    assert theory.satisfies_constraint(world, theory.best_policy(world))


@settings(max_examples=300, deadline=None)
@given(staged_worlds(), SEEDS)
def test_no_better_policy_breaks_it(world: theory.RewardedWorld, seed: int) -> None:
    """Of two policies, the one with less mass on its way has no higher value: the constraint is what to optimise."""
    one = random_policy(world, seed)
    assume(theory.policy_values(world, one)[world.start] < theory.best_values(world)[world.start] - 1e-6)
    assert theory.lost_masses(world, one).max() > TOLERANCE


def risky(trap: float, discount: float = 0.9) -> theory.RewardedWorld:
    """From 0, the short way to the goal 3 ends in the trap 4 by chance; the long way, by 1 and 2, is safe."""
    transitions = np.zeros((5, 2, 5))
    transitions[0, 0, [3, 4]] = 1 - trap, trap
    transitions[0, 1, 1] = transitions[1, :, 2] = transitions[2, :, 3] = transitions[3, :, 3] = transitions[4, :, 4] = 1
    return theory.RewardedWorld(
        transitions, np.array([0.0, 0, 0, 1, 0]), np.array([False, False, False, True, True]), 0, discount
    )


@pytest.mark.parametrize(("trap", "detours"), [(0.0, False), (0.1, False), (0.3, True), (0.9, True)])
def test_where_the_short_way_is_risky_the_optimum_takes_a_detour(trap: float, detours: bool) -> None:
    """The counter-example: the shorter path leads to the same reward with another probability (Definition 8 fails).

    The short way is worth 1 - trap, the long one .81. By pi-distance the optimum then makes two steps too many.
    """
    world = risky(trap)
    policy = theory.best_policy(world)
    short, long = np.eye(2)[[0] * 5], np.eye(2)[[1] * 5]
    assert bool(policy[0, 1]) is detours
    assert theory.policy_distances(world, short)[0, 3] == pytest.approx(1)
    assert theory.policy_distances(world, policy)[0, 3] == pytest.approx(3 if detours else 1)
    assert theory.best_values(world)[0] == pytest.approx(max(1 - trap, 0.81))
    assert theory.policy_values(world, long)[0] == pytest.approx(0.81)


def test_where_a_reward_is_a_penalty_the_optimum_dawdles() -> None:
    """The other counter-example: R + V is negative, so the later the better."""
    transitions = np.zeros((3, 2, 3))
    transitions[0, 0, 2] = transitions[0, 1, 1] = transitions[1, :, 2] = transitions[2, :, 2] = 1
    world = theory.RewardedWorld(transitions, np.array([0.0, 0, -1]), np.array([False, False, True]), 0, 0.5)
    policy = theory.best_policy(world)
    assert policy[0].tolist() == [0.0, 1.0]
    assert not theory.satisfies_constraint(world, policy)
    assert theory.lost_masses(world, policy)[0, 2] == pytest.approx(0.5 - 0.25)
