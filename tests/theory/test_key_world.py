"""The world of KeyDoors against the environment, and the reduction there."""

from __future__ import annotations

import gymnasium
import numpy as np
import pytest

import sprl_bench  # noqa: F401 - registers the ids
from sprl_bench import solver, theory
from sprl_bench.envs.grid.encoding import FORWARD, PICKUP, TOGGLE, TURN_LEFT, TURN_RIGHT

ACTIONS = (TURN_LEFT, TURN_RIGHT, FORWARD, PICKUP, TOGGLE)


@pytest.mark.parametrize("seed", range(8))
def test_it_moves_as_the_environment_does(seed: int) -> None:
    """Two thousand random steps: equal states have equal observations, and the goal ends both."""
    rng = np.random.default_rng(seed)
    env = gymnasium.make("SPRL/KeyDoors-7x7-v1")
    observation, _ = env.reset(seed=seed)
    first = env.unwrapped.np_random.bit_generator.state
    world = theory.key_world(observation)
    seen: dict[int, bytes] = {world.start: observation.tobytes()}
    state, length = world.start, 0
    for _ in range(2000):
        action = int(rng.integers(len(ACTIONS)))
        observation, _, terminated, truncated, _ = env.step(ACTIONS[action])
        state, length = int(world.successors[state, action]), length + 1
        assert terminated == world.goal[state]
        if terminated or truncated:
            env.unwrapped.np_random.bit_generator.state = first
            env.reset(seed=seed)
            state, length = world.start, 0
        else:
            assert seen.setdefault(state, observation.tobytes()) == observation.tobytes()
    assert len(set(seen.values())) == len(seen) > 20


@pytest.mark.parametrize("seed", range(10))
def test_the_shortest_path_is_the_solvers(seed: int) -> None:
    observation, _ = gymnasium.make("SPRL/KeyDoors-7x7-v1").reset(seed=seed)
    world = theory.key_world(observation)
    path = theory.shortest_path(world)
    assert len(path) - 1 == solver.distances_to_goal(observation[None])[0]
    table = theory.distances(world)
    assert all(theory.is_admissible(path, table, k) for k in (1, 2, 5, 100))
    shares = [theory.shares(world, k, 8)[-1] for k in (0, 1, 2, 3, 5)]
    assert shares == sorted(shares, reverse=True)
    assert shares[-1] < 0.05 * shares[0]


def test_only_maps_of_key_doors() -> None:
    observation, _ = gymnasium.make("SPRL/FourRooms-7x7-v1").reset(seed=0)
    with pytest.raises(ValueError, match="it must be a map of KeyDoors"):
        theory.key_world(observation)
