"""The batched engine in lock-step with SyncVectorEnv over the single environments, and its states."""

from __future__ import annotations

import copy
import os
import pickle
from collections import Counter
from typing import Any

os.environ.setdefault("SDL_VIDEODRIVER", "dummy")

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import data_equivalence
from gymnasium.vector import SyncVectorEnv
from hypothesis import given, settings
from hypothesis import strategies as st

import sprl_bench  # noqa: F401 - registers the ids
from sprl_bench import solver
from sprl_bench.envs import MAZE_IDS as IDS

SMALL, LARGE, MANY = IDS
MODES = ("SameStep", "NextStep", "Disabled")
SHORT = int(os.environ.get("SPRL_MAZE_LOCKSTEP_STEPS", "3000"))  # steps in each level and mode; .ci/run has more
LONG = int(os.environ.get("SPRL_LOCKSTEP_STEPS", "1000000"))


def assert_same(ours: Any, theirs: Any, where: str = "") -> None:
    """Compare type, dtype, shape and value, through tuples, dicts and arrays of objects."""
    assert data_equivalence(ours, theirs, exact=True), where


def policy(envs: Any, rng: np.random.Generator) -> np.ndarray:
    """Half of the sub-environments act at random, the others mostly as the solver does."""
    num_envs, highest = envs.num_envs, envs.single_action_space.n
    at_random = (np.arange(num_envs) % 2 == 1) | (rng.random(num_envs) < 0.1)
    return np.where(at_random, rng.integers(highest, size=num_envs), solver.maze_actions(envs.mazes))


def lock_step(
    env_id: str,
    mode: str,
    num_envs: int,
    steps: int,
    *,
    seed: int = 0,
    num_threads: int = 1,
    reset_rate: float = 0.01,
    **arguments: Any,
) -> Counter[str]:
    """Run both for `steps` vector steps, with masked resets and moves to a fresh engine in between."""
    rng = np.random.default_rng([seed, num_envs])

    def new() -> Any:
        return gymnasium.make_vec(env_id, num_envs, autoreset_mode=mode, num_threads=num_threads, **arguments)

    ours = new()
    theirs = SyncVectorEnv([lambda: gymnasium.make(env_id, **arguments)] * num_envs, autoreset_mode=mode)
    assert (ours.observation_space, ours.action_space) == (theirs.observation_space, theirs.action_space)
    assert ours.metadata == theirs.metadata
    assert_same(ours.reset(seed=seed), theirs.reset(seed=seed))
    ended = np.zeros(num_envs, bool)
    happened: Counter[str] = Counter()
    for step in range(steps):
        mask = ended & (mode == "Disabled")
        if rng.random() < reset_rate:
            mask[rng.integers(num_envs)] = True
        if mask.any():
            new_seed = [None, int(rng.integers(2**31))][rng.integers(2)]
            options = {"reset_mask": mask}
            assert_same(ours.reset(seed=new_seed, options=options), theirs.reset(seed=new_seed, options={**options}))
            happened["masked resets"] += 1
        if rng.random() < 0.01:
            moved = new()
            moved.set_state(ours.get_state())
            ours = moved
            happened["states moved"] += 1
        actions = policy(ours, rng)
        result = ours.step(actions)
        assert_same(result, theirs.step(actions), f"{env_id} {mode} N={num_envs} step {step}")
        ended = result[2] | result[3]
        rewards = result[1]
        happened += Counter(
            steps=num_envs, truncated=int(result[3].sum()), paid=int((rewards > 0).sum()), lost=int((rewards < 0).sum())
        )
    for one, other in zip(ours.np_random, theirs.np_random, strict=True):
        assert one.bit_generator.state == other.bit_generator.state
    assert ours.np_random_seed == theirs.np_random_seed
    return happened


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("env_id", IDS)
def test_many_steps_equal_those_of_the_single_environments(env_id: str, mode: str) -> None:
    happened = lock_step(env_id, mode, 5, SHORT // 5, seed=3, max_episode_steps=170)
    assert happened["paid"] >= 5
    assert happened["truncated"] >= 10
    assert (happened["lost"] > 0) == (env_id == MANY)


@pytest.mark.parametrize("env_id", IDS)
def test_the_end_of_a_whole_episode_equals_that_of_the_single_environments(env_id: str) -> None:
    horizon = 1350 if env_id == SMALL else 1800
    happened = lock_step(env_id, "SameStep", 2, horizon + 20, seed=1, reset_rate=0)
    assert happened["truncated"] == 2
    assert happened["paid"] >= 10


@pytest.mark.slow
@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("env_id", IDS)
def test_very_many_steps_equal_those_of_the_single_environments(env_id: str, mode: str) -> None:
    happened = lock_step(env_id, mode, 32, LONG // len(MODES) // 32, seed=1, num_threads=2)
    assert happened["truncated"] > 0


@given(
    env_id=st.sampled_from(IDS),
    mode=st.sampled_from(MODES),
    num_envs=st.sampled_from([1, 2, 3, 17]),
    num_threads=st.integers(1, 3),
    steps=st.integers(1, 25),
    seed=st.integers(0, 2**70),
    limit=st.sampled_from([None, 1, 7]),
    fire=st.booleans(),
    fog=st.booleans(),
    distance=st.integers(0, 12),
)
@settings(max_examples=25, deadline=None)
def test_any_small_run_equals_that_of_the_single_environments(
    env_id: str,
    mode: str,
    num_envs: int,
    num_threads: int,
    steps: int,
    seed: int,
    limit: int | None,
    fire: bool,
    fog: bool,
    distance: int,
) -> None:
    arguments: dict[str, Any] = {"fire": fire, "fog": fog} | ({} if limit is None else {"max_episode_steps": limit})
    if env_id != MANY:
        arguments["minimum_goal_distance"] = distance
    lock_step(env_id, mode, num_envs, steps, seed=seed, num_threads=num_threads, **arguments)


def engine(env_id: str = SMALL, num_envs: int = 4, **arguments: Any) -> Any:
    envs = gymnasium.make_vec(env_id, num_envs, **arguments)
    envs.reset(seed=0)
    return envs


def run(envs: Any, steps: int, seed: int = 0) -> list[Any]:
    rng = np.random.default_rng(seed)
    return [envs.step(policy(envs, rng)) for _ in range(steps)]


def test_results_do_not_depend_on_threads_or_on_the_number_of_mazes() -> None:
    one, many = (engine(MANY, 40, num_threads=count) for count in (1, 3))
    few = engine(MANY, 3)
    rng = np.random.default_rng(0)
    for _ in range(60):
        actions = rng.integers(9, size=40)
        expected = one.step(actions)
        assert_same(many.step(actions), expected)
        np.testing.assert_array_equal(few.step(actions[:3])[0], expected[0][:3])
    many.close()


@pytest.mark.parametrize("env_id", IDS)
def test_a_state_is_a_small_dict_of_arrays_that_survives_a_file(env_id: str, tmp_path: Any) -> None:
    envs = engine(env_id, 5, max_episode_steps=50)
    run(envs, 120)
    state = envs.get_state()
    assert all(type(values) is np.ndarray and values.dtype != object for values in state.values())
    assert sum(values.nbytes for values in state.values()) < 5 * 1000  # pictures follow from it
    np.savez(tmp_path / "state.npz", **state)
    other = engine(env_id, 5, max_episode_steps=50)
    other.set_state(dict(np.load(tmp_path / "state.npz")))
    assert_same(other.get_state(), state)
    assert_same(run(other, 80), run(envs, 80))


def test_copies_continue_the_stream_exactly() -> None:
    envs = engine(MANY, 3, max_episode_steps=30)
    run(envs, 40)
    copies = [copy.deepcopy(envs), pickle.loads(pickle.dumps(envs))]
    expected = run(envs, 60)
    for other in copies:
        assert_same(run(other, 60), expected)


def changed(name: str, index: Any, value: Any) -> Any:
    """Return a function that gives a state with one entry changed."""

    def change(state: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        values = state[name].copy()
        values[index] = value
        return {**state, name: values}

    return change


BROKEN_STATES = {
    "a name missing": lambda state: {name: values for name, values in state.items() if name != "poses"},
    "another task": changed("kind", 0, 7),
    "no such layout": changed("layouts", 1, 10_000),
    "a negative layout": changed("layouts", 1, -1),
    "outside": changed("poses", (0, 0), -5),
    "far outside": changed("poses", (0, 1), 2**50),
    "in a wall": changed("poses", (0, slice(0, 2)), 65536 + 100),
    "no direction": changed("poses", (2, 2), 4096),
    "too fast": changed("poses", (2, 3), 4000),
    "a thing in a wall": changed("things", (1, 0), (0, 0, 1)),
    "a thing outside": changed("things", (1, 0), (11, 3, 1)),
    "an object": changed("things", (1, 0, 2), 2),
    "no goal": changed("things", (1, 0, 2), 0),
    "no such pattern": changed("looks", (1, 0), 24),
    "no such colour": changed("looks", (1, 1), 256),
    "no such key": changed("looks", (1, -1), -1),
    "negative time": changed("elapsed", 0, -1),
}


@pytest.mark.parametrize("broken", BROKEN_STATES.values(), ids=BROKEN_STATES)
def test_a_state_that_cannot_be_is_refused_and_changes_nothing(broken: Any) -> None:
    envs, untouched = engine(), engine()
    before = envs.get_state()
    with pytest.raises(ValueError, match=r"^state"):
        envs.set_state(broken(before))
    assert_same(envs.get_state(), before)
    assert_same(run(envs, 10), run(untouched, 10))


def test_a_state_of_other_arguments_is_refused() -> None:
    with pytest.raises(ValueError, match=r"state\['kind'\] is .*; it must be that of this engine, GoalSmall"):
        engine(fog=True).set_state(engine().get_state())


BAD_ACTIONS = {
    "too few": np.zeros(3, int),
    "float": np.zeros(4),
    "bool": np.zeros(4, bool),
    "too large": np.array([0, 1, 9, 2]),
    "negative": np.array([0, -1, 1, 2]),
    "none": None,
}


@pytest.mark.parametrize("actions", BAD_ACTIONS.values(), ids=BAD_ACTIONS)
def test_bad_actions_are_named_and_change_nothing(actions: Any) -> None:
    envs, untouched = engine(), engine()
    run(envs, 5), run(untouched, 5)
    with pytest.raises((TypeError, ValueError), match=r"actions.* is .*; it must be"):
        envs.step(actions)
    assert_same(run(envs, 10), run(untouched, 10))


def test_pictures_for_people_are_those_of_the_single_environments() -> None:
    arguments = {"render_mode": "rgb_array"}
    ours = gymnasium.make_vec(MANY, 3, **arguments)
    theirs = SyncVectorEnv([lambda: gymnasium.make(MANY, **arguments)] * 3, autoreset_mode="SameStep")
    assert_same(ours.reset(seed=0), theirs.reset(seed=0))
    rng = np.random.default_rng(0)
    for _ in range(5):
        assert_same(ours.render(), theirs.render())
        actions = rng.integers(9, size=3)
        assert_same(ours.step(actions), theirs.step(actions))


def test_human_mode_draws_and_changes_nothing() -> None:
    shown, plain = engine(num_envs=2, render_mode="human"), engine(num_envs=2)
    assert_same(run(shown, 3), run(plain, 3))
    assert shown._viewer._window is not None
    shown.close()


def test_a_sub_environment_taken_out_goes_on_as_in_the_engine() -> None:
    envs = engine(MANY, 3, fog=True)
    run(envs, 50)
    taken = [envs.sub_env(row) for row in range(3)]
    rng = np.random.default_rng(0)
    for _ in range(200):
        actions = policy(envs, rng)
        observations, rewards, *_ = envs.step(actions)
        for row, single in enumerate(taken):
            observation, reward, *_ = single.step(actions[row])
            np.testing.assert_array_equal(observation, observations[row])
            assert reward == rewards[row]
