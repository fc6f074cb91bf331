"""The batched engine in lock-step with SyncVectorEnv over the single environments: every return, bit for bit."""

from __future__ import annotations

import copy
import hashlib
import os
import pickle
import random
from collections import Counter
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import data_equivalence
from gymnasium.vector import SyncVectorEnv, VectorEnv
from hypothesis import given, settings
from hypothesis import strategies as st

import sprl_bench  # noqa: F401 - registers the ids
from sprl_bench import solver
from sprl_bench.envs import GRID_IDS as IDS
from sprl_bench.envs.grid.encoding import CLOSED, DONE, LOCKED, OPEN

MODES = ("SameStep", "NextStep", "Disabled")
LONG = int(os.environ.get("SPRL_LOCKSTEP_STEPS", "2000000"))


def synchronous(env_id: str, num_envs: int, mode: str, **arguments: Any) -> SyncVectorEnv:
    return SyncVectorEnv([lambda: gymnasium.make(env_id, **arguments)] * num_envs, autoreset_mode=mode)


def assert_same(ours: Any, theirs: Any, where: str = "") -> None:
    """Compare type, dtype, shape and value, through tuples, dicts and arrays of objects."""
    assert data_equivalence(ours, theirs, exact=True), where


def policy(observations: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Half of the sub-environments act at random, the others mostly walk a shortest path to the goal."""
    num_envs = len(observations)
    at_random = (np.arange(num_envs) % 2 == 0) | (rng.random(num_envs) < 0.2)
    return np.where(at_random, rng.integers(7, size=num_envs), solver.optimal_actions(observations))


def events(before: np.ndarray, after: np.ndarray, restarted: np.ndarray) -> Counter[str]:
    """Count what happened to doors and keys in the sub-environments that were not restarted."""
    old, new = solver.parse(before[~restarted]), solver.parse(after[~restarted])
    hand = before.shape[1] ** 2
    return Counter(
        unlocked=int(((old.door_state == LOCKED) & (new.door_state == OPEN)).sum()),
        closed=int(((old.door_state == OPEN) & (new.door_state == CLOSED)).sum()),
        opened=int(((old.door_state == CLOSED) & (new.door_state == OPEN)).sum()),
        picked_up=int(((old.key != hand) & (new.key == hand)).sum()),
        dropped=int(((old.key == hand) & (new.key != hand)).sum()),
    )


def some(rng: np.random.Generator, num_envs: int) -> np.ndarray:
    """Return a mask of about a tenth of the sub-environments, and at least one."""
    mask = rng.random(num_envs) < 0.1
    mask[rng.integers(num_envs)] = True
    return mask


def some_seed(rng: np.random.Generator, num_envs: int) -> int | list[int | None] | None:
    """Return one of the three kinds of seed."""
    listed = [int(seed) if seed % 2 else None for seed in rng.integers(2**40, size=num_envs)]
    return [None, int(rng.integers(2**31)), listed][rng.integers(3)]


def lock_step(
    env_id: str, mode: str, num_envs: int, steps: int, *, seed: int = 0, reset_rate: float = 0.02, **arguments: Any
) -> Counter[str]:
    """Run both for `steps` vector steps, with masked resets and moves to a fresh engine in between."""
    rng = np.random.default_rng([seed, num_envs])
    ours: VectorEnv = gymnasium.make_vec(env_id, num_envs, autoreset_mode=mode, **arguments)
    theirs = synchronous(env_id, num_envs, mode, **arguments)
    assert ours.observation_space == theirs.observation_space
    assert ours.action_space == theirs.action_space
    assert ours.metadata == theirs.metadata
    first = ours.reset(seed=seed)
    assert_same(first, theirs.reset(seed=seed))
    observations, ended = first[0], np.zeros(num_envs, bool)
    happened: Counter[str] = Counter()
    for step in range(steps):
        needed = ended & (mode == "Disabled")
        mask = needed | some(rng, num_envs) if rng.random() < reset_rate else needed
        if mask.any():
            new_seed = some_seed(rng, num_envs)
            ours_reset = ours.reset(seed=new_seed, options={"reset_mask": mask.copy()})
            theirs_reset = theirs.reset(seed=new_seed, options={"reset_mask": mask.copy()})
            assert_same(ours_reset, theirs_reset, f"masked reset before step {step}")
            observations, ended = ours_reset[0], ended & ~mask
            happened["masked resets"] += 1
        if rng.random() < reset_rate:
            state = ours.get_state()
            ours.step(rng.integers(7, size=num_envs)) if mode != "Disabled" else None
            ours = gymnasium.make_vec(env_id, num_envs, autoreset_mode=mode, **arguments)
            ours.set_state(state)
            happened["states moved"] += 1
        actions = policy(observations, rng)
        result = ours.step(actions)
        assert_same(result, theirs.step(actions), f"{env_id} {mode} N={num_envs} step {step}")
        restarted = ended if mode == "NextStep" else np.zeros(num_envs, bool)
        ended = result[2] | result[3]
        happened += events(observations, result[0], restarted | (ended & (mode == "SameStep")))
        happened += Counter(
            steps=num_envs, terminated=int(result[2].sum()), truncated=int(result[3].sum()),
            both=int((result[2] & result[3]).sum()),
        )  # fmt: skip
        observations = result[0]
    assert ours.np_random_seed == theirs.np_random_seed
    for one, other in zip(ours.np_random, theirs.np_random, strict=True):
        assert one.bit_generator.state == other.bit_generator.state
    return happened


def assert_lively(happened: Counter[str], env_id: str) -> None:
    """Check that the comparison saw what it is for."""
    doors = ("unlocked", "closed", "opened", "picked_up", "dropped") if "KeyDoors" in env_id else ()
    for event in ("terminated", "truncated", "masked resets", "states moved", *doors):
        assert happened[event] >= 20, (event, happened)
    assert happened["both"] == 0


@pytest.mark.parametrize("env_id", IDS)
def test_a_hundred_thousand_steps_equal_those_of_the_single_environments(env_id: str) -> None:
    happened: Counter[str] = Counter()
    for mode in MODES:
        for num_envs, steps in ((64, 400), (7, 900), (3, 600), (1, 500)):
            happened += lock_step(env_id, mode, num_envs, steps, seed=num_envs)
    assert happened["steps"] >= 100_000
    assert_lively(happened, env_id)


@pytest.mark.slow
@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("env_id", IDS)
def test_very_many_steps_equal_those_of_the_single_environments(env_id: str, mode: str) -> None:
    happened = lock_step(env_id, mode, 256, LONG // len(MODES) // 256 + 1, seed=1)
    assert_lively(happened, env_id)


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("limit", [1, 6, 14, 100, -1])
@pytest.mark.parametrize("env_id", [IDS[0], IDS[2]])
def test_a_time_limit_acts_as_the_wrapper_does(env_id: str, limit: int, mode: str) -> None:
    happened = lock_step(env_id, mode, 20, 80 if 0 < limit < 100 else 130, seed=limit + 5, max_episode_steps=limit)
    assert happened["truncated"] > 0 or not 0 < limit < 100
    if (limit, env_id) in ((6, IDS[0]), (14, IDS[2])):
        assert happened["both"] > 0  # the wrapper truncates even where the goal terminates


@given(
    env_id=st.sampled_from(IDS),
    mode=st.sampled_from(MODES),
    num_envs=st.integers(1, 5),
    steps=st.integers(1, 40),
    seed=st.integers(0, 2**70),
    limit=st.sampled_from([None, 1, 5, 100]),
)
@settings(max_examples=40, deadline=None)
def test_any_small_run_equals_that_of_the_single_environments(
    env_id: str, mode: str, num_envs: int, steps: int, seed: int, limit: int | None
) -> None:
    arguments = {} if limit is None else {"max_episode_steps": limit}
    lock_step(env_id, mode, num_envs, steps, seed=seed, reset_rate=0.3, **arguments)


@pytest.mark.parametrize("env_id", IDS)
def test_the_goal_on_the_last_step_of_the_horizon_only_terminates(env_id: str) -> None:
    """Each sub-environment waits until its shortest path ends exactly at step 100."""
    num_envs = 32
    ours, theirs = gymnasium.make_vec(env_id, num_envs), synchronous(env_id, num_envs, "SameStep")
    observations, _ = ours.reset(seed=3)
    theirs.reset(seed=3)
    distances = solver.distances_to_goal(observations)
    for step in range(100):
        actions = np.where(step < 100 - distances, DONE, solver.optimal_actions(observations))
        observations, rewards, terminated, truncated, infos = result = ours.step(actions)
        assert_same(result, theirs.step(actions))
        assert terminated.any() == (step == 99)
    assert terminated.all()
    assert not truncated.any()
    assert infos["final_info"]["is_success"].all()
    np.testing.assert_array_equal(rewards, 1 - 0.9 * (100 / 100))


@pytest.mark.parametrize("env_id", [IDS[1], IDS[2]])
def test_the_number_of_threads_changes_nothing(env_id: str, monkeypatch: pytest.MonkeyPatch) -> None:
    from sprl_bench.envs.grid.grid_engine import GridEngine

    monkeypatch.setattr(GridEngine, "grain", 3)
    alone, together = (gymnasium.make_vec(env_id, 50, num_threads=count) for count in (1, 5))
    rng = np.random.default_rng(0)
    assert_same(alone.reset(seed=0), together.reset(seed=0))
    for _ in range(150):
        actions = rng.integers(7, size=50)
        assert_same(alone.step(actions), together.step(actions))
    together.close()


def test_copying_an_engine_continues_both_alike() -> None:
    ours = gymnasium.make_vec(IDS[2], 9)
    ours.reset(seed=1)
    rng = np.random.default_rng(0)
    for _ in range(50):
        ours.step(rng.integers(7, size=9))
    copies = [copy.deepcopy(ours), pickle.loads(pickle.dumps(ours))]
    for _ in range(150):
        actions = rng.integers(7, size=9)
        result = ours.step(actions)
        for other in copies:
            assert_same(other.step(actions), result)


GOLDEN = {
    "SPRL/FourRooms-7x7-v1": "f3d08058e9305e15",
    "SPRL/FourRooms-11x11-v1": "207784e930b50bd2",
    "SPRL/KeyDoors-7x7-v1": "6c8da4571f90c155",
    "SPRL/KeyDoors-11x11-v1": "329b76e6ca981f92",
}


@pytest.mark.parametrize("env_id", IDS)
def test_a_version_stays_the_same_environment(env_id: str) -> None:
    """What a seed and some actions lead to is part of the id: whoever changes these hashes needs a new version."""
    rng = random.Random(0)  # its random() is promised never to change
    envs = gymnasium.make_vec(env_id, 64)
    digest = hashlib.sha256(envs.reset(seed=0)[0].tobytes())
    for _ in range(600):
        *arrays, infos = envs.step([int(7 * rng.random()) for _ in range(64)])
        for array in (*arrays, infos["position"]):
            digest.update(array.tobytes())
    assert digest.hexdigest()[:16] == GOLDEN[env_id]
