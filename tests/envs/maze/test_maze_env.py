"""The single mazes: the contract of each id, the rules of each level, and what the arguments do."""

from __future__ import annotations

import copy
import os
import pickle
from typing import Any

os.environ.setdefault("SDL_VIDEODRIVER", "dummy")

import gymnasium
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec
from gymnasium.error import ResetNeeded
from gymnasium.utils.env_checker import check_env, data_equivalence
from gymnasium.vector import AsyncVectorEnv

import sprl_bench  # noqa: F401 - registers the ids
from sprl_bench import solver
from sprl_bench.envs import MAZE_IDS as IDS
from sprl_bench.envs.maze.levels import BAD, FIRE, FORWARD, GOAL, GOOD, LEVELS, NOTHING, PLACE, SPAWN
from sprl_bench.envs.maze.motion import CELL
from sprl_bench.envs.maze.raycast import SIDE

SMALL, LARGE, MANY = IDS
HORIZONS = {SMALL: 1350, LARGE: 1800, MANY: 1800}
NO_SCREEN = "ignore:.*XDG_RUNTIME_DIR"


def rollout(env: Any, steps: int, seed: int = 0) -> list[tuple]:
    """Act at random, reset where an episode ends, and return everything that came back."""
    rng = np.random.default_rng(seed)
    results: list[tuple] = []
    for _ in range(steps):
        results.append(env.step(int(rng.integers(8))))
        if results[-1][2] or results[-1][3]:
            results.append(env.reset())
    return results


def solve(env: Any, steps: int) -> list[tuple]:
    """Let the solver act."""
    return [env.step(int(solver.maze_actions(env.unwrapped.mazes)[0])) for _ in range(steps)]


def assert_same(ours: Any, theirs: Any) -> None:
    assert data_equivalence(ours, theirs, exact=True)


def cell_of(env: Any) -> tuple[int, int]:
    x, y = env.unwrapped.mazes.worlds.poses[0, :2] // CELL
    return int(y), int(x)


def things_of(env: Any) -> np.ndarray:
    return env.unwrapped.mazes.worlds.things[0].copy()


@pytest.mark.parametrize("env_id", IDS)
def test_gymnasiums_checker_passes(env_id: str) -> None:
    check_env(gymnasium.make(env_id).unwrapped)
    check_env(gymnasium.make(env_id, render_mode="rgb_array").unwrapped)


@pytest.mark.parametrize("env_id", IDS)
def test_stable_baselines_checker_passes(env_id: str) -> None:
    checker = pytest.importorskip("stable_baselines3.common.env_checker")
    checker.check_env(gymnasium.make(env_id))


def test_the_ids_are_those_of_the_protocol() -> None:
    assert IDS == ("SPRL/MazeGoalSmall-v1", "SPRL/MazeGoalLarge-v1", "SPRL/MazeObjectMany-v1")


@pytest.mark.parametrize("env_id", IDS)
def test_an_id_describes_what_it_makes(env_id: str) -> None:
    assert gymnasium.spec(env_id).max_episode_steps is None
    for fire, num_actions in ((True, 9), (False, 8)):
        for made in (gymnasium.make(env_id, fire=fire), gymnasium.make_vec(env_id, 3, fire=fire)):
            space = getattr(made, "single_observation_space", made.observation_space)
            assert space == gymnasium.spaces.Box(0, 255, (84, 84, 3), np.uint8)
            actions = getattr(made, "single_action_space", made.action_space)
            assert actions == gymnasium.spaces.Discrete(num_actions)
            assert EnvSpec.from_json(made.spec.to_json()) == made.spec


@pytest.mark.parametrize("env_id", IDS)
def test_types_are_plain_and_arrays_are_new(env_id: str) -> None:
    env = gymnasium.make(env_id)
    observation, info = env.reset(seed=0)
    assert set(info) == {"is_success", "position", "goal_distance"}
    kept, copies = [observation, info["position"]], [observation.copy(), info["position"].copy()]
    for observation, *rest, info in (env.step(action) for action in [0, 4, 6, 0, 0, 5, 1, 2, 3, 7, 8] * 3):
        assert [type(value) for value in rest] == [float, bool, bool]
        assert [type(info[name]) for name in ("is_success", "goal_distance")] == [bool, int]
        assert (info["position"].dtype, info["position"].shape) == (np.int64, (2,))
        kept += [observation, info["position"]]
        copies += [observation.copy(), info["position"].copy()]
    for array, as_it_was in zip(kept, copies, strict=True):
        np.testing.assert_array_equal(array, as_it_was)


@pytest.mark.parametrize("env_id", IDS)
def test_an_episode_has_a_fixed_length_and_is_truncated(env_id: str) -> None:
    env = gymnasium.make(env_id)
    env.reset(seed=0)
    ends = [result[2:4] for result in solve(env, HORIZONS[env_id])]
    assert ends == [(False, False)] * (HORIZONS[env_id] - 1) + [(False, True)]


@pytest.mark.parametrize("env_id", IDS)
def test_a_start_is_at_rest_in_the_middle_of_a_place_for_it(env_id: str) -> None:
    env = gymnasium.make(env_id)
    seen = set()
    for seed in range(30):
        _, info = env.reset(seed=seed)
        worlds = env.unwrapped.mazes.worlds
        assert worlds.cells[0][cell_of(env)] == SPAWN
        assert worlds.poses[0, 3:].tolist() == [0, 0]
        assert (info["position"] % 100).tolist() == [50, 50]
        assert info["is_success"] is False
        for x, y, _ in things_of(env):
            assert worlds.cells[0, y, x] == PLACE
        seen.add((int(worlds.layouts[0]), int(worlds.poses[0, 2]), *worlds.looks[0].tolist()))
    assert len(seen) == 30


@pytest.mark.parametrize(("env_id", "reward"), [(SMALL, 10.0), (LARGE, 10.0)])
def test_at_the_goal_the_agent_goes_on_elsewhere_and_goal_maze_and_look_stay(env_id: str, reward: float) -> None:
    env = gymnasium.make(env_id)
    env.reset(seed=5)
    worlds, goal = env.unwrapped.mazes.worlds, things_of(env)
    before = [worlds.cells.copy(), worlds.looks.copy()]
    starts, success = set(), False
    for _, gained, *_, info in (solve(env, 1)[0] for _ in range(600)):
        assert gained in (0.0, reward)
        success |= gained > 0
        assert info["is_success"] is success
        assert info["goal_distance"] == worlds.distances[0][cell_of(env)]
        if gained:
            starts.add(tuple(info["position"] // 100))
    assert len(starts) > 3
    assert_same([worlds.cells, worlds.looks, things_of(env)], [*before, goal])


def test_after_the_goal_the_agent_is_at_a_start() -> None:
    env = gymnasium.make(SMALL)
    env.reset(seed=5)
    reached = 0
    while reached < 8:
        ((_, reward, *_, info),) = solve(env, 1)
        if reward:
            reached += 1
            assert env.unwrapped.mazes.worlds.cells[0][cell_of(env)] == SPAWN
            assert (info["position"] % 100).tolist() == [50, 50]
            assert env.unwrapped.mazes.worlds.poses[0, 3:].tolist() == [0, 0]


def test_objects_vanish_and_the_level_begins_again_without_good_ones() -> None:
    env = gymnasium.make(MANY)
    env.reset(seed=3)
    assert sorted(things_of(env)[:, 2].tolist()) == [GOOD] * 4 + [BAD] * 4
    worlds, again = env.unwrapped.mazes.worlds, 0
    before = things_of(env)
    for _, reward, *_ in (solve(env, 1)[0] for _ in range(900)):
        after = things_of(env)
        gone = before[(after[:, 2] == NOTHING) & (before[:, 2] != NOTHING), 2]
        if (after[:, 2] == NOTHING).sum() < (before[:, 2] == NOTHING).sum() or (after[:, :2] != before[:, :2]).any():
            again += 1
            assert reward in (2.0, 1.0)
            assert (before[:, 2] == GOOD).sum() == 1
            assert sorted(after[:, 2].tolist()) == [GOOD] * 4 + [BAD] * 4
            assert len({(x, y) for x, y, _ in after.tolist()}) == 8
            assert worlds.cells[0][cell_of(env)] == SPAWN
        else:
            assert reward == {(): 0.0, (GOOD,): 2.0, (BAD,): -1.0}[tuple(gone.tolist())]
        before = after
    assert again >= 3


def test_a_thing_is_taken_within_thirty_units() -> None:
    env = gymnasium.make(SMALL)
    env.reset(seed=0)
    worlds = env.unwrapped.mazes.worlds
    x, y, _ = things_of(env)[0]
    for units, expected in ((30, 10.0), (31, 0.0)):
        worlds.poses[0] = [x * CELL + CELL // 2 + units * CELL // 100, y * CELL + CELL // 2, 0, 0, 0]
        assert env.step(FIRE)[1] == expected


def test_a_bad_object_costs_one_and_is_no_success() -> None:
    env = gymnasium.make(MANY)
    env.reset(seed=0)
    (x, y, _), *_ = [thing for thing in things_of(env) if thing[2] == BAD]
    env.unwrapped.mazes.worlds.poses[0] = [x * CELL + CELL // 2, y * CELL + CELL // 2, 0, 0, 0]
    _, reward, *_, info = env.step(FIRE)
    assert (reward, info["is_success"]) == (-1.0, False)


@pytest.mark.parametrize("env_id", IDS)
def test_the_goal_distance_is_that_of_a_search_over_the_cells(env_id: str) -> None:
    env = gymnasium.make(env_id)
    for seed in range(5):
        _, info = env.reset(seed=seed)
        cells = env.unwrapped.mazes.worlds.cells[0]
        targets = {(y, x) for x, y, kind in things_of(env).tolist() if kind in (GOAL, GOOD)}
        front, distance, seen = {cell_of(env)}, 0, set()
        while not front & targets:
            seen |= front
            around = {(y + a, x + b) for y, x in front for a, b in ((0, 1), (1, 0), (0, -1), (-1, 0))}
            front = {cell for cell in around - seen if cells[cell]}
            distance += 1
        assert info["goal_distance"] == distance


@pytest.mark.parametrize(("env_id", "distance"), [(SMALL, 10), (LARGE, 10), (SMALL, 16), (LARGE, 32)])
def test_a_minimum_goal_distance_is_kept_at_every_start(env_id: str, distance: int) -> None:
    env = gymnasium.make(env_id, minimum_goal_distance=distance)
    for seed in range(40):
        _, info = env.reset(seed=seed)
        assert info["goal_distance"] >= distance
    starts = [info["goal_distance"] for _, reward, *_, info in solve(env, HORIZONS[env_id]) if reward]
    assert starts
    assert min(starts) >= distance


def test_without_a_minimum_starts_are_often_nearer() -> None:
    env = gymnasium.make(SMALL)
    assert min(env.reset(seed=seed)[1]["goal_distance"] for seed in range(40)) < 5


def test_fog_darkens_the_picture_and_changes_nothing_else() -> None:
    clear, foggy = gymnasium.make(LARGE), gymnasium.make(LARGE, fog=True)
    (seen, info), (dark, foggy_info) = clear.reset(seed=0), foggy.reset(seed=0)
    assert_same(info, foggy_info)
    assert (dark <= seen).all()
    assert (dark < seen).mean() > 0.5
    for ours, theirs in zip(rollout(clear, 50), rollout(foggy, 50), strict=True):
        assert_same(ours[1:], theirs[1:])


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        ({"fire": 1}, TypeError, "fire is 1; it must be True or False"),
        ({"fog": "yes"}, TypeError, "fog is 'yes'; it must be True or False"),
        ({"minimum_goal_distance": 2.0}, TypeError, "minimum_goal_distance is 2.0; it must be an integer from 0 to 16"),
        ({"minimum_goal_distance": -1}, ValueError, "minimum_goal_distance is -1; it must be an integer from 0 to 16"),
        ({"minimum_goal_distance": 17}, ValueError, "minimum_goal_distance is 17; it must be an integer from 0 to 16"),
        (
            {"min_goal_distance": 3},
            TypeError,
            r"unexpected keyword argument 'min_goal_distance' .*Did you mean 'minimum_goal_distance'",
        ),
        ({"fires": True}, TypeError, r"Did you mean 'fire'\?"),
    ],
)
@pytest.mark.parametrize("make", [gymnasium.make, gymnasium.make_vec])
def test_a_wrong_argument_is_named(make: Any, arguments: dict, error: type[Exception], message: str) -> None:
    with pytest.raises(error, match=message):
        make(SMALL, **arguments)


@pytest.mark.filterwarnings("ignore:.*not in the possible render_modes")
@pytest.mark.parametrize("make", [gymnasium.make, gymnasium.make_vec])
def test_a_wrong_render_mode_is_named_with_a_suggestion(make: Any) -> None:
    with pytest.raises(ValueError, match=r"render_mode is 'rgb_aray'; it must be one of .* Did you mean 'rgb_array'\?"):
        make(SMALL, render_mode="rgb_aray")


def test_objects_have_no_minimum_goal_distance() -> None:
    with pytest.raises(ValueError, match="minimum_goal_distance is 5; it must be an integer from 0 to 0"):
        gymnasium.make(MANY, minimum_goal_distance=5)


BAD_ACTIONS = [-1, 9, 10**30, float("nan"), 1.0, np.float32(2), "2", None, [2], np.array([2]), True, np.bool_(1)]


@pytest.mark.parametrize("action", BAD_ACTIONS, ids=repr)
def test_a_bad_action_is_named_and_changes_nothing(action: Any) -> None:
    env = gymnasium.make(SMALL)
    env.reset(seed=0)
    rollout(env, 5)
    before = pickle.dumps(env)
    with pytest.raises((TypeError, ValueError), match=r"action is .*; it must be an integer from 0 to 8"):
        env.step(action)
    assert_same(rollout(env, 50), rollout(pickle.loads(before), 50))


def test_without_fire_there_are_eight_actions() -> None:
    env = gymnasium.make(SMALL, fire=False)
    env.reset(seed=0)
    with pytest.raises(ValueError, match="action is 8; it must be an integer from 0 to 7"):
        env.step(FIRE)


def test_a_step_needs_a_reset_first() -> None:
    with pytest.raises(ResetNeeded, match=r"step\(\) needs a reset"):
        gymnasium.make(SMALL).unwrapped.step(FORWARD)


@pytest.mark.parametrize("env_id", IDS)
def test_a_seed_decides_the_whole_stream_and_only_the_seed(env_id: str) -> None:
    first, second = (gymnasium.make(env_id, max_episode_steps=60) for _ in range(2))
    expected = [first.reset(seed=9), *rollout(first, 200)]
    second.reset(seed=1)
    rollout(second, 77)
    np.random.seed(0)  # noqa: NPY002 - the global generator must not matter
    assert_same([second.reset(seed=9), *rollout(second, 200)], expected)
    assert not np.array_equal(first.reset(seed=10)[0], expected[0][0])


def test_the_generator_of_the_environment_is_the_only_one() -> None:
    """What is drawn from it by others moves the episodes on."""
    one, other = (gymnasium.make(SMALL) for _ in range(2))
    one.reset(seed=0), other.reset(seed=0)
    assert one.np_random.random() == other.np_random.random()
    other.np_random.random()
    assert not np.array_equal(one.reset()[0], other.reset()[0])


@pytest.mark.filterwarnings(NO_SCREEN)
@pytest.mark.parametrize("render_mode", [None, "rgb_array", "human"])
@pytest.mark.parametrize("env_id", [SMALL, MANY])
def test_copies_continue_the_stream_exactly(env_id: str, render_mode: str | None) -> None:
    env = gymnasium.make(env_id, render_mode=render_mode, max_episode_steps=40)
    env.unwrapped.metadata = {**env.unwrapped.metadata, "render_fps": 100_000}
    env.reset(seed=0)
    solve(env, 30)
    copies = [copy.deepcopy(env), pickle.loads(pickle.dumps(env))]
    steps = 100 if render_mode is None else 15
    expected = rollout(env, steps, seed=1)
    for other in copies:
        assert_same(rollout(other, steps, seed=1), expected)
        other.close()
    env.close()


def test_spawned_workers_know_the_ids() -> None:
    env_id = f"sprl_bench:{MANY}"
    workers = AsyncVectorEnv([lambda: gymnasium.make(env_id)] * 2, context="spawn", autoreset_mode="SameStep")
    here = gymnasium.make_vec(env_id, 2)
    try:
        np.testing.assert_array_equal(workers.reset(seed=4)[0], here.reset(seed=4)[0])
        rng = np.random.default_rng(0)
        for _ in range(40):
            actions = rng.integers(9, size=2)
            for theirs, ours in zip(workers.step(actions)[:4], here.step(actions)[:4], strict=True):
                np.testing.assert_array_equal(theirs, ours)
    finally:
        workers.close()


@pytest.mark.parametrize("env_id", IDS)
def test_rendering_shows_both_views_and_touches_nothing(env_id: str) -> None:
    drawn, plain = gymnasium.make(env_id, render_mode="rgb_array"), gymnasium.make(env_id)
    assert_same(drawn.reset(seed=0), plain.reset(seed=0))
    for action in [0, 6, 0, 5, 0] * 5:
        picture = drawn.render()
        assert (picture.shape, picture.dtype) == ((4 * SIDE, 8 * SIDE, 3), np.uint8)
        ours = drawn.step(action)
        assert_same(ours, plain.step(action))
    np.testing.assert_array_equal(drawn.render()[::4, : 4 * SIDE : 4], ours[0])
    above = drawn.render()[:, 4 * SIDE :]
    size = LEVELS[env_id[9:-3]].size
    x, y = (ours[4]["position"] / 100 * 336 / size).astype(int)
    assert above[y, x, 2] > above[y, x, 0] + 100  # the blue agent
    assert above[2, 2].tolist() == above[-2, -2].tolist()  # walls


def test_rendering_needs_a_mode_and_a_reset() -> None:
    env = gymnasium.make(SMALL).unwrapped
    with pytest.warns(UserWarning, match="no render mode"):
        assert env.render() is None
    with pytest.raises(ResetNeeded, match=r"render\(\) needs a reset"):
        gymnasium.make(SMALL, render_mode="rgb_array").unwrapped.render()


def test_the_docstring_has_the_sections_in_order() -> None:
    doc = type(gymnasium.make(SMALL).unwrapped).__mro__[1].__doc__
    sections = [line.strip() for line in doc.splitlines() if line.strip().startswith("## ")]
    assert sections == [
        "## Description", "## Action Space", "## Observation Space", "## Rewards", "## Starting State",
        "## Episode End", "## Arguments", "## Registered Configurations", "## Version history",
    ]  # fmt: skip
    assert all(env_id in doc for env_id in IDS)
