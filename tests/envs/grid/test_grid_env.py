"""The single grid environments: the contract of each id, and Minigrid's own step from the same state."""

from __future__ import annotations

import copy
import os
import pickle
from typing import Any

os.environ.setdefault("SDL_VIDEODRIVER", "dummy")

import gymnasium
import minigrid.core.constants as upstream
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env, data_equivalence
from minigrid import wrappers
from minigrid.core.actions import Actions
from minigrid.envs import DoorKeyEnv, FourRoomsEnv

import sprl_bench  # noqa: F401 - registers the ids
from sprl_bench import solver
from sprl_bench.envs import GRID_IDS as IDS
from sprl_bench.envs.grid import encoding

# What the checkers may say, and why it is no fault.
FONT = "ignore:The system font .* couldn't be found"  # pygame, on machines without that font
IMAGE = "ignore:The minimal resolution for an image is 36x36"  # SB3: its default CNN does not fit; ours does


def rollout(env: Any, steps: int, seed: int = 0) -> list[tuple]:
    """Act at random, reset where an episode ends, and return everything that came back."""
    rng = np.random.default_rng(seed)
    results: list[tuple] = []
    for _ in range(steps):
        results.append(env.step(int(rng.integers(7))))
        if results[-1][2] or results[-1][3]:
            results.append(env.reset())
    return results


def assert_same(ours: Any, theirs: Any) -> None:
    assert data_equivalence(ours, theirs, exact=True)


@pytest.mark.filterwarnings(FONT)
@pytest.mark.parametrize("env_id", IDS)
def test_gymnasiums_checker_passes(env_id: str) -> None:
    check_env(gymnasium.make(env_id).unwrapped)
    check_env(gymnasium.make(env_id, render_mode="rgb_array").unwrapped)


@pytest.mark.filterwarnings(IMAGE)
@pytest.mark.parametrize("env_id", IDS)
def test_stable_baselines_checker_passes(env_id: str) -> None:
    checker = pytest.importorskip("stable_baselines3.common.env_checker")
    checker.check_env(gymnasium.make(env_id))
    checker.check_env(gymnasium.make(env_id, render_mode="rgb_array"))


def test_the_alphabet_is_minigrids() -> None:
    for name in ("empty", "wall", "door", "key", "goal", "agent"):
        assert getattr(encoding, name.upper()) == upstream.OBJECT_TO_IDX[name]
    for name in ("red", "green", "yellow", "grey"):
        assert getattr(encoding, name.upper()) == upstream.COLOR_TO_IDX[name]
    for name in ("open", "closed", "locked"):
        assert getattr(encoding, name.upper()) == upstream.STATE_TO_IDX[name]
    ours = (encoding.TURN_LEFT, encoding.TURN_RIGHT, encoding.FORWARD, encoding.PICKUP, encoding.DROP,
            encoding.TOGGLE, encoding.DONE)  # fmt: skip
    assert ours == tuple(int(action) for action in Actions)
    assert len(Actions) == encoding.NUM_ACTIONS
    for direction, vector in zip(
        (encoding.RIGHT, encoding.DOWN, encoding.LEFT, encoding.UP), ((1, 0), (0, 1), (-1, 0), (0, -1)), strict=True
    ):
        np.testing.assert_array_equal(upstream.DIR_TO_VEC[direction], vector)


@pytest.mark.parametrize("env_id", IDS)
def test_stock_minigrid_takes_the_same_step_from_the_same_state(env_id: str) -> None:
    """The observation is FullyObsWrapper's image with its axes swapped; reward and flags are stock Minigrid's."""
    ours = gymnasium.make(env_id).unwrapped
    stock = FourRoomsEnv() if "FourRooms" in env_id else DoorKeyEnv()
    fully_observed = wrappers.FullyObsWrapper(stock)
    stock.reset(seed=0)
    rng = np.random.default_rng(0)
    observation, _ = ours.reset(seed=0)
    terminations = 0
    for step in range(1500):
        stock.grid, stock.carrying = copy.deepcopy((ours.grid, ours.carrying))
        stock.width, stock.height, stock.max_steps = ours.width, ours.height, 100
        stock.agent_pos, stock.agent_dir, stock.step_count = ours.agent_pos, ours.agent_dir, ours.step_count
        greedy = step % 400 > 150 and rng.random() < 0.8
        action = int(solver.optimal_actions(observation[None])[0] if greedy else rng.integers(7))
        observation, reward, terminated, truncated, info = ours.step(action)
        theirs, their_reward, their_termination, their_truncation, _ = fully_observed.step(action)
        np.testing.assert_array_equal(observation, theirs["image"].swapaxes(0, 1))
        assert (reward, terminated) == (their_reward, their_termination)
        assert truncated == (their_truncation and not terminated)
        assert tuple(info["position"]) == tuple(stock.agent_pos)
        terminations += terminated
        if terminated or truncated:
            observation, _ = ours.reset()
    assert terminations >= 10


@pytest.mark.parametrize("env_id", IDS)
def test_types_are_plain_and_arrays_are_new(env_id: str) -> None:
    env = gymnasium.make(env_id).unwrapped
    observation, info = env.reset(seed=0)
    kept, copies = [observation, info["position"]], [observation.copy(), info["position"].copy()]
    assert set(info) == {"is_success", "position"}
    assert info["is_success"] is False
    for result in rollout(env, 300):
        observation, info = result[0], result[-1]
        assert (observation.dtype, observation.shape) == (np.uint8, (env.size, env.size, 3))
        assert observation.flags.writeable
        assert (info["position"].dtype, info["position"].shape) == (np.int64, (2,))
        x, y = info["position"]
        assert observation[y, x, 0] == encoding.AGENT
        kept += [observation, info["position"]]
        copies += [observation.copy(), info["position"].copy()]
        if len(result) == 5:
            assert [type(value) for value in result[1:4]] == [float, bool, bool]
            assert info["is_success"] is result[2]
    for array, as_it_was in zip(kept, copies, strict=True):
        np.testing.assert_array_equal(array, as_it_was)


def test_the_reward_falls_with_time_by_the_formula() -> None:
    env = gymnasium.make(IDS[0])
    for waiting in (0, 13, 60):
        observation, _ = env.reset(seed=2)
        path = solver.shortest_path(observation)
        rewards = [env.step(action)[1] for action in [encoding.DONE] * waiting + path.tolist()]
        assert rewards[:-1] == [0.0] * (waiting + len(path) - 1)
        assert rewards[-1] == 1 - 0.9 * ((waiting + len(path)) / 100)


@pytest.mark.parametrize("env_id", IDS)
def test_the_hundredth_step_truncates_unless_it_reaches_the_goal(env_id: str) -> None:
    env = gymnasium.make(env_id)
    observation, _ = env.reset(seed=0)
    path = solver.shortest_path(observation).tolist()
    results = [env.step(action) for action in [encoding.DONE] * (100 - len(path)) + path]
    assert [result[2:4] for result in results] == [(False, False)] * 99 + [(True, False)]
    assert results[-1][1] == 1 - 0.9 * (100 / 100)
    env.reset(seed=0)
    results = [env.step(encoding.DONE) for _ in range(100)]
    assert [result[2:4] for result in results] == [(False, False)] * 99 + [(False, True)]
    assert results[-1][4]["is_success"] is False


BAD_ACTIONS = [-1, 7, 10**30, float("nan"), 1.0, np.float32(2), "2", None, [2], np.array([2]), True, np.bool_(1)]


@pytest.mark.parametrize("action", BAD_ACTIONS, ids=repr)
def test_a_bad_action_is_named_and_changes_nothing(action: Any) -> None:
    env = gymnasium.make(IDS[2])
    env.reset(seed=0)
    rollout(env, 5)
    before = pickle.dumps(env)
    with pytest.raises((TypeError, ValueError), match=r"action is .*; it must be an integer from 0 to 6"):
        env.step(action)
    after = pickle.loads(before)
    assert_same(rollout(env, 50), rollout(after, 50))


@pytest.mark.parametrize("action", [2, np.int64(2), np.uint8(2), np.array(2), Actions.forward], ids=repr)
def test_any_integer_is_an_action(action: Any) -> None:
    first, second = (gymnasium.make(IDS[0]) for _ in range(2))
    first.reset(seed=0), second.reset(seed=0)
    assert_same(first.step(action), second.step(2))


@pytest.mark.parametrize("env_id", IDS)
def test_a_seed_decides_the_whole_stream_and_only_the_seed(env_id: str) -> None:
    first, second = (gymnasium.make(env_id) for _ in range(2))
    rollout_before = [first.reset(seed=9), *rollout(first, 400)]
    second.reset(seed=1)
    rollout(second, 77)
    np.random.seed(0)  # noqa: NPY002 - the global generator must not matter
    assert_same([second.reset(seed=9), *rollout(second, 400)], rollout_before)
    assert not np.array_equal(first.reset(seed=10)[0], rollout_before[0][0])


@pytest.mark.filterwarnings(FONT)
@pytest.mark.parametrize("render_mode", [None, "rgb_array", "human"])
@pytest.mark.parametrize("env_id", [IDS[0], IDS[2]])
def test_copies_continue_the_stream_exactly(env_id: str, render_mode: str | None) -> None:
    env = gymnasium.make(env_id, render_mode=render_mode)
    env.unwrapped.metadata = {**env.unwrapped.metadata, "render_fps": 100_000}
    env.reset(seed=0)
    rollout(env, 30)
    copies = [copy.deepcopy(env), pickle.loads(pickle.dumps(env))]
    expected = rollout(env, 150 if render_mode is None else 20, seed=1)
    for other in copies:
        assert_same(rollout(other, 150 if render_mode is None else 20, seed=1), expected)
    env.close()


@pytest.mark.filterwarnings(FONT)
@pytest.mark.parametrize("env_id", IDS)
def test_rendering_draws_the_grid_and_touches_nothing(env_id: str) -> None:
    drawn, plain = gymnasium.make(env_id, render_mode="rgb_array"), gymnasium.make(env_id)
    assert_same(drawn.reset(seed=0), plain.reset(seed=0))
    rng = np.random.default_rng(0)
    for _ in range(60):
        action = int(rng.integers(7))
        size, frame = drawn.unwrapped.size, drawn.render()
        assert (frame.shape, frame.dtype) == ((32 * size, 32 * size, 3), np.uint8)
        assert_same(drawn.step(action), plain.step(action))
        if drawn.unwrapped.step_count == 0:
            drawn.reset(), plain.reset()
    goal_y, goal_x = np.argwhere(drawn.unwrapped.gen_obs()[..., 0] == encoding.GOAL)[0]
    assert frame[32 * goal_y + 16, 32 * goal_x + 16].tolist() == [0, 255, 0]


def test_videos_can_be_recorded(tmp_path: Any) -> None:
    pytest.importorskip("moviepy")
    env = gymnasium.wrappers.RecordVideo(gymnasium.make(IDS[0], render_mode="rgb_array"), str(tmp_path / "videos"))
    env.reset(seed=0)
    for _ in range(100):
        env.step(encoding.DONE)
    env.close()
    assert list(tmp_path.glob("videos/*.mp4"))


def test_minigrids_observation_independent_wrappers_work() -> None:
    reseeded = wrappers.ReseedWrapper(gymnasium.make(IDS[0]), seeds=[3, 4])
    firsts = [reseeded.reset()[0] for _ in range(4)]
    np.testing.assert_array_equal(firsts[0], firsts[2])
    np.testing.assert_array_equal(firsts[1], gymnasium.make(IDS[0]).reset(seed=4)[0])
    for bonus in (wrappers.ActionBonus, wrappers.PositionBonus):
        env = bonus(gymnasium.make(IDS[2]))
        env.reset(seed=0)
        rewards = [env.step(encoding.DONE)[1] for _ in range(4)]
        np.testing.assert_allclose(rewards, 1 / np.sqrt([1, 2, 3, 4]))
    noisy = wrappers.StochasticActionWrapper(gymnasium.make(IDS[0]), prob=0.0, random_action=encoding.TURN_LEFT)
    observation, info = noisy.reset(seed=0)
    x, y = info["position"]
    turned = noisy.step(encoding.DONE)[0]
    assert turned[y, x, 2] == (observation[y, x, 2] - 1) % 4
    rollout(wrappers.StochasticActionWrapper(noisy.env, prob=0.5), 50)


@pytest.mark.parametrize("env_id", IDS)
def test_the_docstring_has_minigrids_sections_in_order(env_id: str) -> None:
    doc = type(gymnasium.make(env_id).unwrapped).__mro__[1].__doc__
    sections = [line.strip() for line in doc.splitlines() if line.strip().startswith("## ")]
    assert sections == [
        "## Description", "## Mission Space", "## Action Space", "## Observation Encoding", "## Rewards",
        "## Termination", "## Arguments", "## Registered Configurations", "## Version history",
    ]  # fmt: skip
    assert env_id in doc
