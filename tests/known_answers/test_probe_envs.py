"""The probes: what pays in them, and that they are sound environments."""

from __future__ import annotations

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from sprl_bench.known_answers.probe_envs import DELAY, GRID, KNOWN, register

ANY, DELAYED, OBSERVATION = KNOWN


@pytest.fixture(autouse=True)
def registered() -> None:
    register()
    register()  # is idempotent


@pytest.mark.parametrize("env_id", KNOWN)
def test_a_probe_is_a_sound_environment_with_the_spaces_of_four_rooms(env_id: str) -> None:
    env, grid = gymnasium.make(env_id), gymnasium.make(GRID)
    check_env(env.unwrapped, skip_render_check=True)
    assert (env.observation_space, env.action_space) == (grid.observation_space, grid.action_space)


def mean_return(env_id: str, act: object, episodes: int = 400) -> float:
    env = gymnasium.make(env_id)
    total = 0.0
    for seed in range(episodes):
        observation, _ = env.reset(seed=seed)
        ended = False
        while not ended:
            observation, reward, ended, _, info = env.step(act(observation))  # type: ignore[operator]
            total += reward
            assert info["is_success"] == (reward == 1)
    return total / episodes


def map_of(observation: np.ndarray) -> int:  # type: ignore[type-arg]
    """The number of a map: which of the two it is."""
    first = gymnasium.make(GRID).reset(seed=0)[0]
    return int(not np.array_equal(observation, first))


def test_any_action_pays_where_any_does() -> None:
    assert {mean_return(ANY, lambda _, action=action: action, 5) for action in range(7)} == {1.0}


def test_only_the_first_action_counts_where_the_reward_is_late() -> None:
    env = gymnasium.make(DELAYED)
    for first, later, expected in ((0, 5, 1.0), (5, 0, 0.0)):
        env.reset(seed=0)
        steps = [env.step(first), *(env.step(later) for _ in range(DELAY))]
        assert [step[1] for step in steps] == [0.0] * DELAY + [expected]
        assert [step[2] for step in steps] == [False] * DELAY + [True]


def test_the_right_action_depends_on_the_observation() -> None:
    assert mean_return(OBSERVATION, map_of) == 1.0
    assert mean_return(OBSERVATION, lambda _: 0) == pytest.approx(0.0, abs=0.15)
    assert mean_return(OBSERVATION, lambda seen: 1 - map_of(seen)) == -1.0
    assert mean_return(OBSERVATION, lambda _: 5) == 0.0


@pytest.mark.parametrize("env_id", KNOWN)
def test_chance_has_its_known_return(env_id: str) -> None:
    drawn = np.random.default_rng(0)
    assert mean_return(env_id, lambda _: drawn.integers(7)) == pytest.approx(KNOWN[env_id][0], abs=0.06)
