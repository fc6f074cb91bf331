"""Small stochastic worlds with rewards: the value of a policy, and the best values.

A world has states, actions and probabilities. A reward is paid each time its state is reached. A state that ends the
episode has no value of its own.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from sprl_bench.envs.checks import check_array, check_integer
from sprl_bench.theory.small_worlds import Flags, World

Floats = NDArray[np.float64]

TOLERANCE: Final = 1e-12  # of values


@dataclass(frozen=True, eq=False)
class RewardedWorld:
    """A world with one start, in which the next state may be random.

    Attributes:
        transitions: Probability of each next state, [S, A, S].
        rewards: For reaching a state, [S].
        ends: Whether the state ends the episode, [S].
        start: Where an episode starts.
        discount: For each step, above 0 and below 1.

    Raises:
        ValueError: A shape is wrong, a row is no distribution, or a number is not finite or out of range.
    """

    transitions: Floats
    rewards: Floats
    ends: Flags
    start: int
    discount: float

    def __post_init__(self) -> None:
        states = len(self.rewards)
        shape = self.transitions.shape
        if len(shape) != 3 or not self.transitions.size or (shape[0], shape[2]) != (states, states):
            raise ValueError(f"transitions is {list(shape)}; it must be [S, A, S], where S is {states}, as of rewards.")
        if (self.transitions < 0).any() or not np.allclose(self.transitions.sum(axis=2), 1):
            raise ValueError("transitions holds a row that is no distribution; each must be at least 0 and sum to 1.")
        if not np.isfinite(self.rewards).all():
            raise ValueError(f"rewards is {self.rewards}; it must be finite numbers.")
        check_array("ends", self.ends, (states,), np.dtype(np.bool_))
        check_integer("start", self.start, 0, states - 1)
        if not 0 < self.discount < 1:
            raise ValueError(f"discount is {self.discount}; it must be above 0 and below 1.")

    @property
    def rewarding(self) -> Flags:
        """Whether reaching the state is rewarded, [S]."""
        return np.asarray(self.rewards != 0)

    @property
    def num_actions(self) -> int:
        """A."""
        return int(self.transitions.shape[1])


def rewarded(world: World, discount: float) -> RewardedWorld:
    """Return a deterministic world with a reward of 1 for reaching the goal, which ends the episode."""
    transitions = np.eye(len(world.successors))[world.successors]
    return RewardedWorld(transitions, world.goal.astype(np.float64), world.goal, world.start, discount)


def policy_transitions(world: RewardedWorld, policy: Floats) -> Floats:
    """Return the probability of each next state under a policy, [S, S]; rows of states that end the episode are 0.

    Args:
        world: The world.
        policy: Probability of each action, [S, A].

    Raises:
        ValueError: The policy has another shape, or a row is no distribution.
    """
    check_array("policy", policy, world.transitions.shape[:2], np.dtype(np.float64))
    if (policy < 0).any() or not np.allclose(policy.sum(axis=1), 1):
        raise ValueError("policy holds a row that is no distribution; each must be at least 0 and sum to 1.")
    moves = np.einsum("sa,san->sn", policy, world.transitions)
    return np.where(world.ends[:, None], 0.0, moves)


def policy_values(world: RewardedWorld, policy: Floats) -> Floats:
    """Return the expected discounted sum of rewards from each state, [S]; exact up to rounding."""
    moves = policy_transitions(world, policy)
    return np.asarray(np.linalg.solve(np.eye(len(moves)) - world.discount * moves, moves @ world.rewards))


def best_values(world: RewardedWorld) -> Floats:
    """Return the highest values that any policy has, [S], by value iteration."""
    values: Floats = np.zeros(len(world.rewards))
    while True:
        better: Floats = action_values(world, values).max(axis=1)
        if np.abs(better - values).max() <= TOLERANCE:
            return values
        values = better


def action_values(world: RewardedWorld, values: Floats) -> Floats:
    """Return the value of each action if the next states have these values, [S, A]."""
    after: Floats = world.transitions @ (world.rewards + world.discount * values)
    return np.where(world.ends[:, None], 0.0, after)


def best_policy(world: RewardedWorld) -> Floats:
    """Return a deterministic optimal policy, [S, A]: of equally good actions, the first."""
    values = action_values(world, best_values(world))
    is_best = values >= values.max(axis=1, keepdims=True) - 1e3 * TOLERANCE
    policy: Floats = np.eye(world.num_actions)[is_best.argmax(axis=1)]
    return policy
