"""The competent player of the mazes: it collects reward in every maze, by shortest paths."""

from __future__ import annotations

import gymnasium
import numpy as np
import pytest

import sprl_bench  # noqa: F401 - registers the ids
from sprl_bench import solver
from sprl_bench.envs import MAZE_IDS as IDS
from sprl_bench.envs.maze.levels import BAD
from sprl_bench.policies import find_actor
from sprl_bench.tasks import SUITES

SMALL, LARGE, MANY = IDS
MAZES = 50


@pytest.mark.parametrize("env_id", IDS)
def test_it_collects_reward_in_every_maze_soon(env_id: str) -> None:
    envs = gymnasium.make_vec(env_id, MAZES)
    _, infos = envs.reset(seed=100)
    expected = infos["goal_distance"] * 100 / 320 * 60 / 4  # steps at top speed
    first = np.full(MAZES, np.inf)
    for step in range(1, 400):
        rewards = envs.step(solver.maze_actions(envs.mazes))[1]
        first = np.where((rewards > 0) & np.isinf(first), step, first)
    assert (first <= 1.6 * expected + 45).all()  # and some steps to turn


@pytest.mark.parametrize("env_id", IDS)
def test_no_return_leaves_the_range_of_the_task(env_id: str) -> None:
    task = SUITES["maze"].task(env_id[5:-3])
    envs = gymnasium.make_vec(env_id, 10)
    envs.reset(seed=0)
    total = sum(envs.step(solver.maze_actions(envs.mazes))[1] for _ in range(1800 if env_id != SMALL else 1350))
    low, high = task.score_range
    assert (total > low + 0.1 * (high - low)).all()
    assert (total < high).all()


def test_distances_fall_by_one_from_cell_to_cell() -> None:
    envs = gymnasium.make_vec(LARGE, 20)
    envs.reset(seed=0)
    distances = solver.maze_distances(envs.mazes)
    np.testing.assert_array_equal(distances == -1, envs.mazes.worlds.cells == 0)
    for row, (x, y, _) in enumerate(envs.mazes.worlds.things[:, 0]):
        assert distances[row, y, x] == 0
        for cell_y, cell_x in np.argwhere(distances[row] > 0):
            around = distances[row, [cell_y, cell_y, cell_y - 1, cell_y + 1], [cell_x - 1, cell_x + 1, cell_x, cell_x]]
            assert around[around >= 0].min() == distances[row, cell_y, cell_x] - 1


def test_paths_avoid_bad_objects() -> None:
    envs = gymnasium.make_vec(MANY, 50)
    envs.reset(seed=0)
    worlds = envs.mazes.worlds
    distances, plain = solver.maze_distances(envs.mazes), worlds.distances
    is_open = plain >= 0
    assert (distances[is_open] >= plain[is_open]).all()
    assert (distances != plain).any()
    for row, things in enumerate(worlds.things):
        for x, y, kind in things:
            if kind == BAD:
                assert distances[row, y, x] == plain[row, y, x]


@pytest.mark.parametrize("policy", ["solver", "still"])
def test_films_have_their_policies(policy: str) -> None:
    env = gymnasium.make(SMALL)
    observation, info = env.reset(seed=0)
    act = find_actor(policy).begin(env, 0)
    total = 0.0
    for _ in range(150):
        observation, reward, *_, after = env.step(act(observation))
        total += reward
    assert (total > 0) == (policy == "solver")
    if policy == "still":
        np.testing.assert_array_equal(after["position"], info["position"])


def test_standing_still_needs_the_action_fire() -> None:
    with pytest.raises(ValueError, match="fire is False; it must be True for the policy 'still'"):
        find_actor("still").begin(gymnasium.make(SMALL, fire=False), 0)
