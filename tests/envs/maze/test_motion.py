"""The motion: the speeds of DeepMind Lab's levels, walls that stop and guide, and no way out."""

from __future__ import annotations

import os

import gymnasium
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import sprl_bench  # noqa: F401 - registers the ids
from sprl_bench.envs import MAZE_IDS as IDS
from sprl_bench.envs.maze.directions import DIRECTIONS
from sprl_bench.envs.maze.levels import BACK, FIRE, FORWARD, LOOK_LEFT, LOOK_RIGHT, STRAFE_LEFT, STRAFE_RIGHT, WALL
from sprl_bench.envs.maze.motion import CELL, HALF_WIDTH, TOP_SPEED, eased, move

STEPS = int(os.environ.get("SPRL_MAZE_STEPS", "30000"))  # random steps in each level
EAST, SOUTH = 0, DIRECTIONS // 4


def hall(size: int = 60) -> np.ndarray:
    cells = np.ones((1, size, size), np.uint8)
    cells[0, [0, -1]] = cells[0, :, [0, -1]] = WALL
    return cells


def walk(cells: np.ndarray, pose: list[int], action: int, frames: int) -> np.ndarray:
    """Return the poses [frames + 1, 5]."""
    poses = np.array([pose], np.int64)
    seen = [poses[0].copy()]
    for _ in range(frames):
        move(cells, poses, 0, action)
        seen.append(poses[0].copy())
    return np.array(seen)


@pytest.mark.parametrize("action", [FORWARD, BACK, STRAFE_LEFT, STRAFE_RIGHT])
@pytest.mark.parametrize("angle", [0, 333, 1024, 2500, 4095])
def test_the_top_speed_is_320_units_a_second_and_is_reached_smoothly(action: int, angle: int) -> None:
    seen = walk(hall(), [30 * CELL, 30 * CELL, angle, 0, 0], action, 40)
    speeds = np.hypot(*np.diff(seen[:, :2], axis=0).T) / CELL * 100 * 60  # units a second
    assert (np.diff(speeds[:10]) > 0).all()
    assert speeds[0] == pytest.approx(80, abs=1)
    assert speeds[-1] == pytest.approx(320, abs=0.2)
    steps = np.hypot(*(seen[4:, :2] - seen[:-4, :2]).T) / CELL
    assert steps.max() < 0.2134


def test_directions_are_those_of_a_map() -> None:
    start = [30 * CELL, 30 * CELL]
    for angle, action, x, y in (
        (EAST, FORWARD, 1, 0),
        (EAST, BACK, -1, 0),
        (EAST, STRAFE_RIGHT, 0, 1),
        (EAST, STRAFE_LEFT, 0, -1),
        (SOUTH, FORWARD, 0, 1),
        (SOUTH, STRAFE_RIGHT, -1, 0),
    ):
        moved = np.sign(walk(hall(), [*start, angle, 0, 0], action, 4)[-1, :2] - start)
        assert moved.tolist() == [x, y]


def test_a_look_turns_by_about_eight_degrees_and_stays_in_place() -> None:
    for action, sign in ((LOOK_RIGHT, 1), (LOOK_LEFT, -1)):
        end = walk(hall(), [CELL * 9, CELL * 9, 2000, 0, 0], action, 4)[-1]
        assert (end[2] - 2000) * 360 / DIRECTIONS == pytest.approx(8.4 * sign, abs=0.05)
        assert end[[0, 1, 3, 4]].tolist() == [CELL * 9, CELL * 9, 0, 0]
    assert 0 <= walk(hall(), [CELL * 9, CELL * 9, 5, 0, 0], LOOK_LEFT, 4)[-1, 2] < DIRECTIONS


@pytest.mark.parametrize("action", [FIRE, LOOK_LEFT])
def test_without_a_wish_to_move_the_agent_comes_to_rest(action: int) -> None:
    seen = walk(hall(), [30 * CELL, 30 * CELL, 0, TOP_SPEED, -TOP_SPEED // 2], action, 60)
    assert seen[-1, 3:].tolist() == [0, 0]
    assert (np.diff(abs(seen[:20, 3])) < 0).all()


@given(speed=st.integers(-TOP_SPEED, TOP_SPEED), wanted=st.integers(-TOP_SPEED, TOP_SPEED))
def test_a_speed_approaches_what_is_wanted_and_mirrors(speed: int, wanted: int) -> None:
    after = eased(speed, wanted)
    assert min(speed, wanted) <= after <= max(speed, wanted)
    assert (after == speed) == (speed == wanted)
    assert eased(-speed, -wanted) == -after


@pytest.mark.parametrize("angle", [0, 300, 400, 700, 1100, 1700, 2500, 3900])
def test_the_agent_slides_along_a_wall(angle: int) -> None:
    size = 40
    seen = walk(hall(size), [20 * CELL, 20 * CELL, angle, 0, 0], FORWARD, 5000)
    low, high = CELL + HALF_WIDTH, (size - 1) * CELL - HALF_WIDTH - 1
    assert ((seen[:, :2] >= low) & (seen[:, :2] <= high)).all()
    touches = (seen[:, :2] == low) | (seen[:, :2] == high)
    expected = [True, angle not in (0,)]  # straight along x it never meets a wall along x
    assert touches[-1].tolist() == expected
    if angle:  # it reached one wall first, and then went on along it
        first, second = sorted(np.argmax(touches, axis=0))
        assert second > first + 10


@pytest.mark.parametrize("env_id", IDS)
def test_no_random_walk_leaves_the_free_cells(env_id: str) -> None:
    num_envs = 100
    envs = gymnasium.make_vec(env_id, num_envs)
    envs.reset(seed=0)
    rng = np.random.default_rng(0)
    actions = rng.choice(9, p=[0.3, 0.1, 0.1, 0.1, 0.08, 0.08, 0.12, 0.12, 0], size=(STEPS // num_envs, num_envs))
    rows, before, moved = np.arange(num_envs), envs.mazes.worlds.poses.copy(), 0.0
    for chosen in actions:
        _, rewards, _, truncations, _ = envs.step(chosen)
        worlds = envs.mazes.worlds
        for x_side in (-HALF_WIDTH, HALF_WIDTH):
            for y_side in (-HALF_WIDTH, HALF_WIDTH):
                x, y = (worlds.poses[:, 0] + x_side) >> 16, (worlds.poses[:, 1] + y_side) >> 16
                assert (worlds.cells[rows, y, x] != WALL).all()
        stayed = ~truncations & (rewards <= 0)
        distances = np.hypot(*(worlds.poses - before)[stayed, :2].T) / CELL
        moved = max(moved, distances.max(initial=0))
        before = worlds.poses.copy()
    assert 0.2 < moved < 0.2134
