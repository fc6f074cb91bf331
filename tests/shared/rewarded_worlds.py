"""Random small worlds with rewards, and all their deterministic policies."""

from __future__ import annotations

import itertools
from collections.abc import Iterator

import numpy as np
from hypothesis import strategies as st

from sprl_bench import theory
from sprl_bench.theory.values import Floats

DISCOUNTS = st.sampled_from([0.3, 0.5, 0.8])


def all_policies(world: theory.RewardedWorld) -> Iterator[Floats]:
    """Yield every deterministic policy, [S, A]."""
    for actions in itertools.product(range(world.num_actions), repeat=len(world.rewards)):
        yield np.eye(world.num_actions)[list(actions)]


@st.composite
def chancy_worlds(draw: st.DrawFn) -> theory.RewardedWorld:
    """Any probabilities, rewards of both signs, any states that end the episode."""
    states, actions = draw(st.sampled_from([(1, 3), (2, 3), (3, 3), (4, 2)]))
    weights = st.lists(st.sampled_from([0, 0, 0, 1, 1, 3]), min_size=states, max_size=states).filter(any)
    rows = draw(st.lists(weights, min_size=states * actions, max_size=states * actions))
    transitions = np.array(rows, np.float64).reshape(states, actions, states)
    transitions /= transitions.sum(axis=2, keepdims=True)
    rewards = draw(st.lists(st.sampled_from([0.0, 0.0, 1.0, 2.0, -1.0]), min_size=states, max_size=states))
    ends = draw(st.lists(st.booleans(), min_size=states, max_size=states))
    start = draw(st.integers(0, states - 1))
    return theory.RewardedWorld(transitions, np.array(rewards), np.array(ends), start, draw(DISCOUNTS))


@st.composite
def certain_worlds(draw: st.DrawFn) -> theory.RewardedWorld:
    """Deterministic; several positive rewards, which may end the episode or not."""
    states, actions = draw(st.sampled_from([(2, 3), (3, 3), (4, 2), (5, 2)]))
    state = st.integers(0, states - 1)
    table = draw(st.lists(st.lists(state, min_size=actions, max_size=actions), min_size=states, max_size=states))
    rewards = draw(st.lists(st.sampled_from([0.0, 0.0, 0.5, 1.0, 2.0]), min_size=states, max_size=states))
    ends = np.array(draw(st.lists(st.booleans(), min_size=states, max_size=states))) & (np.array(rewards) > 0)
    return theory.RewardedWorld(np.eye(states)[np.array(table)], np.array(rewards), ends, draw(state), draw(DISCOUNTS))


@st.composite
def staged_worlds(draw: st.DrawFn) -> theory.RewardedWorld:
    """Mildly stochastic: rooms in a row, each left by one rewarded gate alone; inside a room, anything may happen.

    So the next reward is the same under every policy, or there is none.
    """
    rooms = draw(st.lists(st.integers(1, 2), min_size=1, max_size=2))
    actions = draw(st.integers(1, 3))
    gates = np.cumsum([size + 1 for size in rooms]) - 1
    states = int(gates[-1]) + 1
    transitions = np.zeros((states, actions, states))
    for room, gate in enumerate(gates):
        first = gates[room - 1] if room else 0  # a gate belongs to the room behind it
        own = [*range(first, gate), gate]
        for here in own[:-1]:
            for action in range(actions):
                inside = [to for to in own if to not in gates[:-1] or to == gate]
                weights = draw(st.lists(st.integers(0, 2), min_size=len(inside), max_size=len(inside)).filter(any))
                transitions[here, action, inside] = np.array(weights) / sum(weights)
    transitions[gates[-1], :, gates[-1]] = 1
    is_gate = np.isin(np.arange(states), gates)
    rewards = np.where(is_gate, draw(st.sampled_from([0.5, 1.0, 3.0])), 0.0)
    return theory.RewardedWorld(transitions, rewards, np.arange(states) == gates[-1], 0, draw(DISCOUNTS))
