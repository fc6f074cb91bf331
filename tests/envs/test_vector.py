"""What a batched engine owes its user beyond the numbers: safety, state, seeds, pictures, clear refusals."""

from __future__ import annotations

import os

os.environ.setdefault("SDL_VIDEODRIVER", "dummy")

from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.error import ResetNeeded
from gymnasium.utils.env_checker import data_equivalence
from gymnasium.vector import AutoresetMode, SyncVectorEnv

import sprl_bench  # noqa: F401 - registers the ids
from sprl_bench.envs import GRID_IDS as IDS
from sprl_bench.envs.threads import Threads, usable_cores

NEVER_SEEN = "ignore:The system font .* couldn't be found"  # pygame, on machines without that font


def engine(env_id: str = IDS[2], num_envs: int = 4, **arguments: Any) -> Any:
    envs = gymnasium.make_vec(env_id, num_envs, **arguments)
    envs.reset(seed=0)
    return envs


def run(envs: Any, steps: int, seed: int = 0) -> list[Any]:
    rng = np.random.default_rng(seed)
    return [envs.step(rng.integers(7, size=envs.num_envs)) for _ in range(steps)]


def assert_same(ours: Any, theirs: Any) -> None:
    assert data_equivalence(ours, theirs, exact=True)


def arrays_in(result: Any) -> list[np.ndarray]:
    """Return every array inside what reset or step returned."""
    if isinstance(result, np.ndarray):
        return [result] if result.dtype != object else [x for x in result if x is not None]
    values = result.values() if isinstance(result, dict) else result
    return [array for value in values for array in arrays_in(value)]


def test_nothing_returned_is_changed_by_what_follows() -> None:
    envs = engine(num_envs=8)
    arrays = arrays_in(envs.reset(seed=3))
    for result in run(envs, 130):
        arrays += arrays_in(result)
    assert any(array.shape == (7, 7, 3) for array in arrays)  # a final observation
    for index, array in enumerate(arrays):
        for other in arrays[index + 1 : index + 30]:
            assert not np.shares_memory(array, other)
    kept = [array.copy() for array in arrays]
    run(envs, 130, seed=1)
    envs.reset()
    for array, copy in zip(arrays, kept, strict=True):
        np.testing.assert_array_equal(array, copy)


def test_what_the_user_does_to_returned_arrays_changes_nothing() -> None:
    envs, untouched = engine(), engine()
    rng = np.random.default_rng(0)
    for _ in range(120):
        actions = rng.integers(7, size=4)
        result = envs.step(actions)
        assert_same(result, untouched.step(actions))
        for array in arrays_in(result):
            array[...] = 1


def test_without_copies_the_same_memory_is_returned_each_time() -> None:
    """Nobody can write to it: the engine would go on from what was written, and not the single environment."""
    envs, copying = engine(copy=False), engine()
    rng = np.random.default_rng(0)
    first = envs.reset(seed=0)[0]
    for _ in range(120):
        actions = rng.integers(7, size=4)
        result = envs.step(actions)
        assert np.shares_memory(result[0], first)
        assert not result[0].flags.writeable
        assert_same(result, copying.step(actions))


BAD_ACTIONS = {
    "too few": np.zeros(3, int),
    "too many axes": np.zeros((4, 1), int),
    "a single number": 2,
    "float": np.zeros(4),
    "nan": np.array([0, 1, np.nan, 2]),
    "bool": np.zeros(4, bool),
    "text": ["0", "1", "2", "3"],
    "none": None,
    "too large": np.array([0, 1, 7, 2]),
    "negative": np.array([0, -1, 1, 2]),
    "huge": np.array([0, 2**64 - 1, 0, 0], np.uint64),
}


@pytest.mark.parametrize("actions", BAD_ACTIONS.values(), ids=BAD_ACTIONS)
def test_bad_actions_are_named_and_change_nothing(actions: Any) -> None:
    envs, untouched = engine(), engine()
    run(envs, 20), run(untouched, 20)
    with pytest.raises((TypeError, ValueError), match=r"actions.* is .*; it must be"):
        envs.step(actions)
    assert_same(envs.get_state(), untouched.get_state())
    assert_same(run(envs, 120), run(untouched, 120))


@pytest.mark.parametrize("dtype", [np.uint8, np.int32, np.uint64, list])
def test_any_integers_are_actions(dtype: Any) -> None:
    envs, plain = engine(), engine()
    actions = np.array([2, 1, 0, 5])
    assert_same(envs.step(actions.tolist() if dtype is list else actions.astype(dtype)), plain.step(actions))


def test_the_action_of_a_sub_environment_that_only_resets_does_not_matter() -> None:
    ours = gymnasium.make_vec(IDS[0], 2, autoreset_mode="NextStep", max_episode_steps=3)
    theirs = SyncVectorEnv([lambda: gymnasium.make(IDS[0], max_episode_steps=3)] * 2, autoreset_mode="NextStep")
    assert_same(ours.reset(seed=0), theirs.reset(seed=0))
    for actions in ([0, 0], [0, 0], [0, 0], [-5, 99], [0, 0]):
        assert_same(ours.step(np.array(actions)), theirs.step(np.array(actions)))


def test_steps_and_states_need_a_reset_first() -> None:
    envs = gymnasium.make_vec(IDS[0], 2, render_mode="rgb_array")
    for needs_reset in (lambda: envs.step(np.zeros(2, int)), envs.get_state, envs.render):
        with pytest.raises(ResetNeeded, match=r"needs a reset\(\)"):
            needs_reset()
    with pytest.raises(ResetNeeded, match="first reset"):
        envs.reset(options={"reset_mask": np.array([True, False])})
    envs.reset()
    envs.step(np.zeros(2, int))


def test_disabled_refuses_to_step_what_is_over() -> None:
    envs = engine(autoreset_mode="Disabled", max_episode_steps=5)
    envs.reset(seed=0, options={"reset_mask": np.array([True, True, True, True])})
    run(envs, 3)
    envs.reset(options={"reset_mask": np.array([True, False, False, False])})
    results = run(envs, 2)
    assert results[-1][3].tolist() == [False, True, True, True]
    state = envs.get_state()
    with pytest.raises(ResetNeeded, match=r"'Disabled'.*\[1, 2, 3\]"):
        run(envs, 1)
    assert_same(envs.get_state(), state)
    envs.reset(options={"reset_mask": np.array([False, True, True, True])})
    run(envs, 1)


@pytest.mark.parametrize(
    ("mask", "error", "message"),
    [
        ([True, False, False, False], TypeError, "is list; it must be a NumPy array of bool"),
        (np.array([1, 0, 0, 0]), TypeError, "is int64; it must be a NumPy array of bool"),
        (np.array([True, False]), ValueError, r"it must have shape \(4,\)"),
        (np.zeros(4, bool), ValueError, "at least one True"),
    ],
)
def test_a_bad_mask_is_named_and_changes_nothing(mask: Any, error: type[Exception], message: str) -> None:
    envs = engine()
    state = envs.get_state()
    with pytest.raises(error, match=rf"options\['reset_mask'\] .*{message}"):
        envs.reset(seed=1, options={"reset_mask": mask})
    assert_same(envs.get_state(), state)


@pytest.mark.parametrize("seed", [-1, 1.0, "12345678", [1, 2], [1, 2, 3, -4], [1, 2, 3, 4.0], np.int64(3)], ids=repr)
def test_a_bad_seed_is_named_and_changes_nothing(seed: Any) -> None:
    envs = engine()
    state = envs.get_state()
    with pytest.raises((TypeError, ValueError), match=r"seed .*; it must"):
        envs.reset(seed=seed)
    assert_same(envs.get_state(), state)


def test_without_a_seed_the_streams_are_random_and_then_go_on() -> None:
    envs, other = (gymnasium.make_vec(IDS[0], 3) for _ in range(2))
    envs.reset(), other.reset()
    assert len({*envs.np_random_seed, *other.np_random_seed}) == 6
    seeds = envs.np_random_seed
    first, _ = envs.reset(seed=list(seeds))
    singles = [gymnasium.make(IDS[0]) for _ in seeds]
    for single, seed, observation in zip(singles, seeds, first, strict=True):
        np.testing.assert_array_equal(single.reset(seed=seed)[0], observation)
    second, _ = envs.reset()
    for single, observation in zip(singles, second, strict=True):
        np.testing.assert_array_equal(single.reset()[0], observation)
    assert envs.np_random_seed == seeds


def test_generators_are_those_of_the_sub_environments_and_drawing_from_them_is_harmless() -> None:
    envs, untouched = engine(), engine()
    for generator, seed in zip(envs.np_random, range(4), strict=True):
        single = gymnasium.make(IDS[2])
        single.reset(seed=seed)
        assert generator.random() == single.np_random.random()
    assert_same(run(envs, 120), run(untouched, 120))


def test_a_state_is_a_plain_dict_of_arrays_that_survives_a_file(tmp_path: Any) -> None:
    envs = engine(num_envs=5, autoreset_mode="NextStep")
    run(envs, 97)
    state = envs.get_state()
    assert all(type(name) is str and type(values) is np.ndarray for name, values in state.items())
    assert all(values.dtype != object for values in state.values())
    np.savez(tmp_path / "state.npz", **state)
    other = engine(num_envs=5, autoreset_mode="NextStep")
    other.set_state(dict(np.load(tmp_path / "state.npz")))
    assert other.np_random_seed == (0, 1, 2, 3, 4)
    assert_same(other.get_state(), state)
    expected = run(envs, 120)
    assert_same(run(other, 120), expected)
    unused = gymnasium.make_vec(IDS[2], 5, autoreset_mode="NextStep")
    unused.set_state(state)  # the engine that gave the state has moved on; the state has not
    assert_same(run(unused, 120), expected)


@pytest.mark.parametrize("seed", [0, 2**64 - 1, 2**64, 2**127, 2**200])
def test_a_state_keeps_seeds_of_any_size(seed: int) -> None:
    envs = gymnasium.make_vec(IDS[0], 2)
    envs.reset(seed=seed)
    other = gymnasium.make_vec(IDS[0], 2)
    other.set_state(envs.get_state())
    assert other.np_random_seed == (seed, seed + 1)


def test_a_state_of_another_task_is_refused() -> None:
    """Its arrays have the same names and shapes."""
    doors, rooms = (gymnasium.make_vec(f"SPRL/{name}-7x7-v1", 2) for name in ("KeyDoors", "FourRooms"))
    doors.reset(seed=0)
    with pytest.raises(ValueError, match=r"state\['kind'\] is .*; it must be that of this engine, FourRooms7x7"):
        rooms.set_state(doors.get_state())


def changed(name: str, index: Any, value: Any) -> Any:
    """Return a function that gives a state with one entry changed."""

    def change(state: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        values = state[name].copy()
        values[index] = value
        return {**state, name: values}

    return change


BROKEN_STATES = {
    "not a dict": lambda state: [state],
    "a name missing": lambda state: {name: values for name, values in state.items() if name != "agents"},
    "a name too many": lambda state: {**state, "extra": np.zeros(4)},
    "a list": lambda state: {**state, "elapsed": [0, 0, 0, 0]},
    "another N": lambda state: {name: values[:3] for name, values in state.items()},
    "another type": lambda state: {**state, "agents": state["agents"].astype(np.float64)},
    "a list of seeds": lambda state: {**state, "seeds": [[0, 0]] * 4},
    "a seed": lambda state: {**state, "seeds": 0},
    "ended under SameStep": changed("ended", 2, True),
    "another task": changed("kind", 0, 7),
    "two agents": changed("observations", (1, slice(1, 3), slice(1, 3), 0), 10),
    "an agent drawn otherwise": lambda state: {**state, "agents": (state["agents"] + (0, 0, 1)) % (9, 9, 4)},
    "standing on a key": changed("beneath", (3, 0), 5),
    "seeds without limbs": lambda state: {**state, "seeds": state["seeds"][:, 0]},
    "an agent in the wall": changed("agents", (1, 0), 0),
    "an agent outside": changed("agents", (1, 1), 7),
    "an agent far outside": changed("agents", (1, 1), -(10**12)),
    "an agent elsewhere": changed("agents", (1, slice(0, 2)), (2, 2)),
    "no direction": changed("agents", (1, 2), 4),
    "a hole in the wall": changed("observations", (2, 0, 3, 0), 1),
    "no such object": changed("observations", (2, 3, 3, 0), 200),
    "negative time": changed("elapsed", 0, -1),
}


@pytest.mark.parametrize("broken", BROKEN_STATES.values(), ids=BROKEN_STATES)
def test_a_state_that_cannot_be_is_refused_and_changes_nothing(broken: Any) -> None:
    envs = engine()
    before = envs.get_state()
    with pytest.raises(ValueError, match=r"^state"):
        envs.set_state(broken(before))
    assert_same(envs.get_state(), before)


@pytest.mark.parametrize("mode", list(AutoresetMode))
def test_metadata_holds_the_enum(mode: AutoresetMode) -> None:
    assert engine(autoreset_mode=mode).metadata["autoreset_mode"] is mode
    assert engine(autoreset_mode=mode.value).metadata["autoreset_mode"] is mode
    assert engine().metadata["autoreset_mode"] is AutoresetMode.SAME_STEP


@pytest.mark.parametrize("env_id", IDS)
def test_frames_are_those_of_the_single_environments_and_cost_nothing(env_id: str) -> None:
    arguments = {"render_mode": "rgb_array"}
    ours = gymnasium.make_vec(env_id, 3, **arguments)
    theirs = SyncVectorEnv([lambda: gymnasium.make(env_id, **arguments)] * 3, autoreset_mode="SameStep")
    assert_same(ours.reset(seed=0), theirs.reset(seed=0))
    rng = np.random.default_rng(0)
    for step in range(110):
        if step % 10 == 0:
            frames = ours.render()
            assert type(frames) is tuple
            assert_same(frames, theirs.render())
        actions = rng.integers(7, size=3)
        assert_same(ours.step(actions), theirs.step(actions))


def test_rendering_without_a_mode_says_so() -> None:
    with pytest.warns(UserWarning, match="no render mode"):
        assert engine().render() == (None,) * 4


@pytest.mark.filterwarnings(NEVER_SEEN)
def test_human_mode_draws_and_changes_nothing() -> None:
    shown, plain = engine(num_envs=2, render_mode="human"), engine(num_envs=2)
    assert_same(run(shown, 5), run(plain, 5))
    assert shown._viewer.window is not None
    shown.close()


@pytest.mark.parametrize("env_id", IDS)
def test_a_sub_environment_taken_out_goes_on_as_in_the_engine(env_id: str) -> None:
    envs = engine(env_id, num_envs=6)
    run(envs, 77)
    taken = [envs.sub_env(row) for row in range(6)]
    rng = np.random.default_rng(0)
    for _ in range(150):
        actions = rng.integers(7, size=6)
        observations, rewards, terminated, truncated, infos = envs.step(actions)
        for row, single in enumerate(taken):
            observation, reward, *flags, info = single.step(actions[row])
            assert [reward, *flags] == [rewards[row], terminated[row], truncated[row]]
            if any(flags):
                np.testing.assert_array_equal(observation, infos["final_obs"][row])
                observation, info = single.reset()
            np.testing.assert_array_equal(observation, observations[row])
            np.testing.assert_array_equal(info["position"], infos["position"][row])


def test_attributes_of_the_sub_environments_can_be_read_but_not_set() -> None:
    envs = engine(num_envs=3)
    run(envs, 10)
    assert envs.get_attr("step_count") == (10, 10, 10)
    assert envs.get_attr("np_random_seed") == envs.np_random_seed
    assert [type(reward) for reward in envs.call("_reward")] == [float] * 3
    with pytest.raises(AttributeError, match="set_state"):
        envs.set_attr("step_count", 0)


def test_gymnasiums_vector_wrappers_work() -> None:
    envs = gymnasium.wrappers.vector.RecordEpisodeStatistics(engine(num_envs=8))
    envs.reset(seed=0)
    results = run(envs, 150)
    assert any("episode" in result[4] for result in results)


@pytest.mark.parametrize("wrapper", ["FlattenObservation", "NormalizeObservation", "NormalizeReward"])
def test_gymnasiums_vector_wrappers_give_what_they_give_over_its_own_environments(wrapper: str) -> None:
    """The first two refuse `SameStep`, and so did those over `SyncVectorEnv`: with its mode they are equal."""
    wrap = getattr(gymnasium.wrappers.vector, wrapper)
    own = gymnasium.make_vec(IDS[0], 4, autoreset_mode="NextStep")
    sync = gymnasium.make_vec(IDS[0], 4, vectorization_mode="sync")
    wrapped = [wrap(envs) for envs in (own, sync)]
    first, other = [envs.reset(seed=3)[0] for envs in wrapped]
    np.testing.assert_array_equal(first, other)
    generator = np.random.default_rng(0)
    for _ in range(250):
        actions = generator.integers(7, size=4)
        steps = [envs.step(actions) for envs in wrapped]
        for ours, theirs in zip(steps[0][:4], steps[1][:4], strict=True):
            np.testing.assert_array_equal(ours, theirs)


@pytest.mark.parametrize("mode", ["SameStep", "NextStep"])
def test_a_swap_for_gymnasiums_own_environments_changes_nothing_in_the_same_mode(mode: str) -> None:
    keywords = {"autoreset_mode": AutoresetMode(mode)}
    ours = gymnasium.make_vec(IDS[0], 3, autoreset_mode=mode)
    theirs = gymnasium.make_vec(IDS[0], 3, vectorization_mode="sync", vector_kwargs=keywords)
    assert ours.metadata["autoreset_mode"] is theirs.metadata["autoreset_mode"]
    np.testing.assert_array_equal(ours.reset(seed=5)[0], theirs.reset(seed=5)[0])
    for step in range(220):
        results = [envs.step(np.full(3, step % 7)) for envs in (ours, theirs)]
        for one, other in zip(results[0][:4], results[1][:4], strict=True):
            np.testing.assert_array_equal(one, other)


def test_threads_cover_every_item_once_and_only_where_it_pays() -> None:
    import threading

    calls: list[tuple[int, int, int]] = []

    def note(start: int, stop: int, offset: int) -> None:
        calls.append((start + offset, stop + offset, threading.get_ident()))

    threads = Threads(3, grain=4)
    for size, slices in ((7, 1), (8, 2), (11, 2), (12, 3), (100, 3)):
        calls.clear()
        threads.map(note, size, 1000)
        assert len(calls) == slices
        covered = sorted(item - 1000 for start, stop, _ in calls for item in range(start, stop))
        assert covered == list(range(size))
    threads.close()
    threads.map(note, 100, 0)  # starts anew
    threads.close()
    assert Threads(None, grain=1).count == usable_cores() >= 1


def test_what_a_thread_raises_is_raised() -> None:
    def fail(start: int, stop: int) -> None:
        if start:
            raise ZeroDivisionError

    threads = Threads(2, grain=1)
    with pytest.raises(ZeroDivisionError):
        threads.map(fail, 2)
    threads.close()
