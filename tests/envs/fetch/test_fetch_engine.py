"""The batched Fetch engine in lock-step with SyncVectorEnv over the single environments: every return, bit for bit."""

from __future__ import annotations

import copy
import itertools
import pickle
from collections import Counter
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode, SyncVectorEnv

import sprl_bench.envs

pytest.importorskip("mujoco.batch")
sprl_bench.envs.register()

TASKS = ("Reach", "Push", "Slide", "PickAndPlace")
MODES = ("SameStep", "NextStep", "Disabled")
RESETS = 50

Result = tuple[Any, ...]


def env_id(task: str) -> str:
    return f"SPRL/Fetch{task}Sparse-v1"


def engine(task: str, num_envs: int, **arguments: Any) -> gymnasium.vector.VectorEnv:
    return gymnasium.make_vec(env_id(task), num_envs, **arguments)


def synchronous(task: str, num_envs: int, mode: str, **arguments: Any) -> SyncVectorEnv:
    def make() -> gymnasium.Env:
        return gymnasium.make(env_id(task), disable_env_checker=True, **arguments)

    return SyncVectorEnv([make] * num_envs, autoreset_mode=AutoresetMode(mode))


def assert_same(ours: Any, theirs: Any, where: str = "") -> None:
    """Compare type, dtype, shape and value, through tuples, dicts and arrays of objects."""
    assert type(ours) is type(theirs), where
    if isinstance(ours, dict):
        assert ours.keys() == theirs.keys(), where
        for key in ours:
            assert_same(ours[key], theirs[key], f"{where}[{key!r}]")
    elif isinstance(ours, tuple):
        assert len(ours) == len(theirs), where
        for index, (one, other) in enumerate(zip(ours, theirs, strict=True)):
            assert_same(one, other, f"{where}[{index}]")
    elif isinstance(ours, np.ndarray):
        assert (ours.dtype, ours.shape) == (theirs.dtype, theirs.shape), where
        if ours.dtype == object:
            assert_same(tuple(ours), tuple(theirs), where)
        else:
            assert np.array_equal(ours, theirs), where
    else:
        assert ours == theirs, where


def first(count: int, result: Any) -> Any:
    """Return what a vector env of the first `count` sub-environments alone would have returned."""
    if isinstance(result, tuple):
        return tuple(first(count, part) for part in result)
    if isinstance(result, dict):
        named = {name for name in result if not name.startswith("_")}
        absent = {name for name in named if f"_{name}" in result and not result[f"_{name}"][:count].any()}
        absent |= {f"_{name}" for name in absent}
        return {name: first(count, value) for name, value in result.items() if name not in absent}
    return result[:count]


def towards_the_goal(observations: Any, rng: np.random.Generator) -> np.ndarray:
    """Return actions, float64, some out of the box: half steer object or gripper roughly to the goal."""
    if isinstance(observations, dict):
        names = ("observation", "achieved_goal", "desired_goal")
        observations = np.concatenate([observations[name] for name in names], axis=1)
    num_envs = len(observations)
    grip, goals = observations[:, :3], observations[:, -3:]
    aims = goals if observations.shape[1] == 16 else observations[:, 3:6]
    steered = np.concatenate([10 * (aims - grip), rng.choice([-1.0, 1.0], (num_envs, 1))], axis=1)
    return np.where(rng.random((num_envs, 1)) < 0.5, steered, rng.uniform(-1.3, 1.3, (num_envs, 4)))


def lock_step(
    task: str,
    mode: str,
    counts: tuple[int, ...],
    threads: tuple[int, ...],
    *,
    episode: int,
    resets: int = RESETS,
    **arguments: Any,
) -> Counter[str]:
    """Run engines of the first N sub-environments beside the largest SyncVectorEnv; return what happened."""
    rng = np.random.default_rng(1)
    most = max(counts)
    theirs = synchronous(task, most, mode, max_episode_steps=episode, **arguments)
    ours = {
        (count, number): engine(
            task, count, num_threads=number, autoreset_mode=mode, max_episode_steps=episode, **arguments
        )
        for count, number in itertools.product(counts, threads)
    }
    happened: Counter[str] = Counter()
    ended = np.zeros(most, bool)
    expected: Result = theirs.reset(seed=7)
    for key, one in ours.items():
        assert one.single_observation_space == theirs.single_observation_space
        assert one.single_action_space == theirs.single_action_space
        assert one.metadata == theirs.metadata
        assert_same(one.reset(seed=7), first(key[0], expected), f"{task} {key} reset")
    for step in range(resets * (episode + (mode == "NextStep"))):
        if mode == "Disabled" and ended.any():
            expected = theirs.reset(options={"reset_mask": ended.copy()})
            for (count, number), one in ours.items():
                if ended[:count].any():
                    result = one.reset(options={"reset_mask": ended[:count].copy()})
                    assert_same(result, first(count, expected), f"{task} {count, number} masked reset before {step}")
        actions = towards_the_goal(expected[0], rng)
        expected = theirs.step(actions)
        for (count, number), one in ours.items():
            where = f"{task} {arguments} {mode} {count, number} step {step}"
            assert_same(one.step(actions[:count]), first(count, expected), where)
        ended = expected[2] | expected[3]
        happened += Counter(
            terminated=int(expected[2].sum()), truncated=int(expected[3].sum()), restarts=int(ended.sum())
        )
    for (count, _), one in ours.items():
        streams = [generator.bit_generator.state for generator in one.np_random]
        assert streams == [generator.bit_generator.state for generator in theirs.np_random[:count]]
        one.close()
    theirs.close()
    assert happened["restarts"] >= resets * most - most
    return happened


# Every value of every factor, every task with every substep and every autoreset mode, and the pairs that interact.
SAMPLE = [
    ("Reach", 20, 0.0, True, "flat", "SameStep", (1, 7), (1, 2)),
    ("Reach", 3, 0.1, True, "goal", "NextStep", (7,), (2,)),
    ("Reach", 8, 0.0, False, "flat", "Disabled", (1, 7), (1,)),
    ("Reach", 1, 0.3, True, "flat", "SameStep", (1, 64), (1, 2)),
    ("Push", 20, 0.1, True, "goal", "Disabled", (7,), (2,)),
    ("Push", 3, 0.0, True, "flat", "SameStep", (1, 7), (1, 2)),
    ("Push", 8, 0.1, False, "flat", "NextStep", (7,), (1,)),
    ("Push", 1, 0.0, True, "flat", "Disabled", (7,), (2,)),
    ("Slide", 20, 0.0, True, "flat", "NextStep", (7,), (2,)),
    ("Slide", 3, 0.0, False, "goal", "Disabled", (7,), (1,)),
    ("Slide", 8, 0.3, True, "flat", "SameStep", (1, 7), (1, 2)),
    ("Slide", 1, 0.0, True, "flat", "NextStep", (7,), (2,)),
    ("PickAndPlace", 20, 0.1, True, "flat", "SameStep", (1, 7), (1, 2)),
    ("PickAndPlace", 3, 0.0, True, "flat", "Disabled", (7,), (2,)),
    ("PickAndPlace", 8, 0.0, False, "goal", "NextStep", (7,), (2,)),
    ("PickAndPlace", 1, 0.1, True, "goal", "SameStep", (1, 7), (1, 2)),
]


@pytest.mark.parametrize(("task", "substep", "noise", "ending", "observation", "mode", "counts", "threads"), SAMPLE)
def test_a_sample_of_engines_equals_the_single_environments(
    task: str,
    substep: int,
    noise: float,
    ending: bool,
    observation: str,
    mode: str,
    counts: tuple[int, ...],
    threads: tuple[int, ...],
) -> None:
    chosen = {"substep": substep, "action_noise": noise, "terminate_on_goal": ending, "observation": observation}
    happened = lock_step(task, mode, counts, threads, episode=2, **chosen)
    assert happened["truncated"] > 0
    if ending and task in ("Reach", "Push"):
        assert happened["terminated"] > 0


@pytest.mark.slow
@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("ending", [True, False])
@pytest.mark.parametrize("noise", [0.0, 0.1])
@pytest.mark.parametrize("substep", [1, 3, 8, 20])
@pytest.mark.parametrize("task", TASKS)
def test_all_engines_equal_the_single_environments(
    task: str, substep: int, noise: float, ending: bool, mode: str
) -> None:
    chosen = {"substep": substep, "action_noise": noise, "terminate_on_goal": ending}
    lock_step(task, mode, (1, 7, 64), (1, 2), episode=4, **chosen)


@pytest.mark.parametrize(("task", "substep"), [("PickAndPlace", 20), ("Slide", 20), ("Push", 8)])
def test_whole_episodes_equal_those_of_the_single_environments(task: str, substep: int) -> None:
    """Long enough for the gripper to reach, push, hit and grasp."""
    episode = 1000 // substep
    happened = lock_step(task, "SameStep", (2,), (2,), episode=episode, resets=3, substep=substep)
    assert happened["truncated"] > 0


def play(envs: gymnasium.vector.VectorEnv, steps: int, seed: int) -> list[Result]:
    actions = np.random.default_rng(seed).uniform(-1, 1, (steps, envs.num_envs, 4))
    return [envs.step(action) for action in actions]


@pytest.mark.parametrize("mode", ["SameStep", "NextStep"])
@pytest.mark.parametrize("task", TASKS)
def test_a_stream_continues_exactly_wherever_it_is_moved(task: str, mode: str) -> None:
    arguments = {"autoreset_mode": mode, "substep": 8, "action_noise": 0.1, "max_episode_steps": 7}
    ours = engine(task, 3, **arguments)
    ours.reset(seed=1)
    play(ours, 11, seed=0)
    moved = engine(task, 3, **arguments)
    moved.reset(seed=99)
    play(moved, 3, seed=5)
    moved.set_state({name: values.copy() for name, values in ours.get_state().items()})
    copies = [copy.deepcopy(ours), pickle.loads(pickle.dumps(ours)), moved]
    expected = play(ours, 20, seed=2)
    for one in copies:
        assert_same(tuple(play(one, 20, seed=2)), tuple(expected))
        assert_same(one.get_state(), ours.get_state())


@pytest.mark.parametrize("task", TASKS)
def test_one_sub_environment_can_be_taken_out_and_goes_on_alike(task: str) -> None:
    ours = engine(task, 3, substep=3, action_noise=0.1)
    ours.reset(seed=1)
    play(ours, 5, seed=0)
    single = ours.sub_env(1)
    actions = np.random.default_rng(3).uniform(-1, 1, (10, 3, 4))
    for action in actions:
        observations, rewards, *_, infos = ours.step(action)
        observation, reward, *_, info = single.step(action[1])
        assert_same(observation, observations[1])
        assert reward == rewards[1]
        assert_same(info["applied_action"], infos["applied_action"][1])


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("task", ["Reach", "PickAndPlace"])
@pytest.mark.parametrize("substep", [1, 3])
def test_a_simulation_that_diverges_ends_only_its_own_episode(
    task: str, mode: str, substep: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)  # MuJoCo logs there
    ours = engine(task, 3, autoreset_mode=mode, substep=substep)
    theirs = synchronous(task, 3, mode, substep=substep)
    assert_same(ours.reset(seed=2), theirs.reset(seed=2))
    actions = np.random.default_rng(3).uniform(-1, 1, (8, 3, 4))
    for step, action in enumerate(actions):
        if step == 3:
            state = ours.get_state()
            ours._simulation._qvel[1] = np.nan
            theirs.envs[1].unwrapped.simulation.data.qvel[:] = np.nan
        result = ours.step(action)
        assert_same(result, theirs.step(action))
        if step == 3:
            assert result[3].tolist() == [False, True, False]
            ends = result[4]["final_info"] if mode == "SameStep" else result[4]
            assert ends["diverged"].tolist() == ends["_diverged"].tolist() == [False, True, False]
            if mode == "Disabled":
                mask = {"reset_mask": np.array([False, True, False])}
                assert_same(ours.reset(options=dict(mask)), theirs.reset(options=dict(mask)))
        else:
            assert "diverged" not in result[4]
    ours.set_state(state)  # of before; nothing of the divergence is left
    assert "diverged" not in ours.step(actions[0])[4]


def test_bad_actions_are_refused_and_change_nothing() -> None:
    ours, twin = engine("Push", 2, action_noise=0.1), engine("Push", 2, action_noise=0.1)
    assert_same(ours.reset(seed=0), twin.reset(seed=0))
    for bad in (
        np.full((2, 4), np.nan),
        np.full((2, 4), np.inf),
        np.full((2, 4), 1e300),
        np.zeros((2, 3)),
        np.zeros(4),
    ):
        with pytest.raises(ValueError, match=r"action .*; it must"):
            ours.step(bad)
    with pytest.raises(TypeError, match="real numbers"):
        ours.step([["a"] * 4] * 2)
    assert_same(tuple(play(ours, 5, seed=1)), tuple(play(twin, 5, seed=1)))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"substep": 0}, r"substep is 0; it must be an integer from 1 to 500"),
        ({"frame_skip": 3}, r"'frame_skip' \(value 3\).* Did you mean 'substep'"),
        ({"num_thread": 3}, r"Did you mean 'num_threads'"),
        ({"num_threads": 0}, r"num_threads is 0; it must be an integer of at least 1"),
        ({"autoreset_mode": "samestep"}, r"Did you mean 'SameStep'"),
        ({"observation": "dict"}, r"observation is 'dict'; it must be one of 'flat', 'goal'"),
    ],
)
def test_bad_arguments_are_named(arguments: dict[str, Any], message: str) -> None:
    with pytest.raises((TypeError, ValueError), match=message):
        engine("Reach", 2, **arguments)


def test_a_state_that_is_not_finite_is_refused_and_nothing_changes() -> None:
    ours = engine("Reach", 2)
    ours.reset(seed=0)
    before = ours.get_state()
    broken = ours.get_state()
    broken["simulations"][0, 3] = np.nan
    with pytest.raises(ValueError, match=r"state\['simulations'\] is not finite"):
        ours.set_state(broken)
    assert_same(ours.get_state(), before)


def test_threads_default_to_what_the_process_may_use() -> None:
    from sprl_bench.envs.threads import usable_cores

    ours = engine("Reach", 2)
    assert ours._simulation._batch.nthread == usable_cores()
    assert engine("Reach", 2, num_threads=1)._simulation._batch.nthread == 1
