"""Count: known answers on trajectories made by hand."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
import pytest
import torch
from gymnasium import spaces

import sprl_bench  # noqa: F401 - registers the ids
from sprl_baselines.bonus import Setting
from sprl_baselines.count import Count, CountConfig
from sprl_baselines.learning.collector import Collector, Decision
from sprl_baselines.learning.rollout import Rollout

CPU = torch.device("cpu")
LEFT, RIGHT, FORWARD, DONE = 0, 1, 2, 6


def played(actions: list[int], env_id: str = "SPRL/FourRooms-7x7-v1", num_envs: int = 1) -> Rollout:
    """Return a rollout of these actions, the same in every sub-env, from one start."""
    envs = gymnasium.make_vec(env_id, num_envs)
    envs.reset(seed=[4] * num_envs)
    collector = Collector(envs, len(actions), CPU)
    collector._observations, infos = envs.reset(seed=[4] * num_envs)
    collector._positions = infos["position"]
    left = iter(actions)
    zeros = torch.zeros(num_envs)
    return collector.collect(lambda _: Decision(torch.full((num_envs,), next(left)), zeros, zeros))


def made(rollout: Rollout, weight: float = 1.0) -> Count:
    space = spaces.Box(0, 255, rollout.observations.shape[2:], np.uint8)
    setting = Setting(space, spaces.Discrete(7), rollout.rewards.shape[1], 0, CPU)
    return Count(setting, CountConfig(bonus_weight=weight))


def test_what_was_never_visited_pays_the_whole_weight() -> None:
    rollout = played([LEFT, LEFT, DONE])
    torch.testing.assert_close(made(rollout, 0.5).reward(rollout), torch.full((3, 1), 0.5))


def test_the_bonus_falls_with_the_square_root_of_the_visits() -> None:
    turn_and_wait = played([LEFT, DONE, DONE])  # one state, three times
    bonus = made(turn_and_wait)
    bonus.update(turn_and_wait)
    torch.testing.assert_close(bonus.reward(turn_and_wait), torch.full((3, 1), (3 + 1) ** -0.5))
    assert bonus.update(turn_and_wait) == {"visited_states": 1.0}
    torch.testing.assert_close(bonus.reward(turn_and_wait), torch.full((3, 1), (6 + 1) ** -0.5))


def test_a_direction_is_a_state_of_its_own() -> None:
    around = played([LEFT] * 4)
    bonus = made(around)
    assert bonus.update(around) == {"visited_states": 4.0}
    torch.testing.assert_close(bonus.reward(played([RIGHT, RIGHT])), torch.full((2, 1), 2**-0.5))


def test_sub_environments_share_the_counts() -> None:
    rollout = played([LEFT], num_envs=3)
    bonus = made(rollout)
    bonus.update(rollout)
    torch.testing.assert_close(bonus.reward(rollout), torch.full((1, 3), 0.5))


def test_key_and_door_are_part_of_the_state() -> None:
    envs = gymnasium.make_vec("SPRL/KeyDoors-7x7-v1", 8)
    envs.reset(seed=0)
    collector = Collector(envs, 300, CPU)
    collector.reset()
    from sprl_bench import solver

    def solve(observations: torch.Tensor) -> Decision:
        zeros = torch.zeros(8)
        return Decision(torch.from_numpy(solver.optimal_actions(observations.numpy())), zeros, zeros)

    rollout = collector.collect(solve)
    bonus = made(rollout)
    bonus.update(rollout)
    by_key_and_door: Any = bonus.visits.reshape(49 * 4, 2, 2).sum(axis=0)
    assert (by_key_and_door[0, 0] > 0, by_key_and_door[1, 0] > 0, by_key_and_door[1, 1] > 0) == (True, True, True)
    assert bonus.visits.sum() == 8 * 300


def test_other_observations_than_grids_are_refused() -> None:
    setting = Setting(spaces.Box(-1, 1, (5,)), spaces.Discrete(2), 1, 0, CPU)
    with pytest.raises(ValueError, match="observation_space is Box"):
        Count(setting, CountConfig())
