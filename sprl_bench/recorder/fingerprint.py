"""The environment's fingerprint: the hash of a fixed trajectory, so that revisions are not compared by accident.

Two environments take random actions, past the first end of an episode in both. Random actions do not reach the reward
of most sparse tasks, so for our own environments golden episodes follow, which do.

A simulator's last bits differ between processors, so numbers are rounded. After a contact that is not enough: a
difference in the last bit grows. With continuous actions, the hash therefore takes all that is seen only in the first
steps, and then only when episodes end. For contacts, the table relies on the simulator's version, which is never mixed.
"""

from __future__ import annotations

import functools
import hashlib
import json
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from gymnasium import Space, spaces
from gymnasium.envs.registration import make_vec
from gymnasium.vector import AutoresetMode, VectorEnv

from sprl_bench.actions import uniform_actions
from sprl_bench.recorder.golden import GOLDEN
from sprl_bench.records import TaskSpec

NUM_ENVS = 2
STEPS = 200  # at least
MOST_STEPS = 2000  # if episodes do not end
SEED = 20240  # of the random episodes and actions
DECIMALS = 5  # simulators differ in later ones between processors
TAME_STEPS = 8  # with continuous actions, after a reset: before any contact


def fingerprint(task: TaskSpec) -> str:
    """Return 16 hexadecimal digits that depend on all that an agent can see in a short, fixed trajectory."""
    return _fingerprint(task.env_id, json.dumps(task.arguments, sort_keys=True))


@functools.cache
def _fingerprint(env_id: str, arguments: str) -> str:
    # Single environments: they equal the engine bit for bit and need no compilation.
    mode = {"autoreset_mode": AutoresetMode.SAME_STEP}
    envs = make_vec(env_id, NUM_ENVS, vectorization_mode="sync", vector_kwargs=mode, **json.loads(arguments))
    try:
        return _trajectory_hash(envs, env_id)
    finally:
        envs.close()


def _trajectory_hash(envs: VectorEnv[Any, Any, Any], env_id: str) -> str:
    digest = hashlib.sha256()
    continuous = isinstance(envs.single_action_space, spaces.Box)
    steps = 0  # since the last reset() call
    for seen in trajectory(envs, env_id):
        steps = steps + 1 if len(seen) > 1 else 0
        _take_in(digest, seen[2:4] if continuous and steps > TAME_STEPS else seen)
    return digest.hexdigest()[:16]


def trajectory(envs: VectorEnv[Any, Any, Any], env_id: str) -> Iterator[tuple[Any, ...]]:
    """Play, and yield all that an agent can see: after a reset the observations, after a step rewards and ends too."""
    generator = np.random.default_rng(SEED)
    yield (envs.reset(seed=SEED)[0],)
    ended = np.zeros(NUM_ENVS, np.bool_)
    for number in range(MOST_STEPS):
        if number >= STEPS and ended.all():
            break
        seen = _step(envs, _random_actions(envs.single_action_space, generator))
        ended |= seen[2] | seen[3]
        yield seen
    if env_id in GOLDEN:
        seeds: Any = list(GOLDEN[env_id].seeds)  # each its own, which Gymnasium's type leaves out
        yield (envs.reset(seed=seeds)[0],)
        for actions in GOLDEN[env_id].actions(envs.single_action_space):
            yield _step(envs, actions)


def _step(envs: VectorEnv[Any, Any, Any], actions: Any) -> tuple[Any, ...]:
    *seen, infos = envs.step(actions)
    return *seen, infos.get("final_obs"), infos.get("final_info", {}).get("is_success")


def _random_actions(space: Space[Any], generator: np.random.Generator) -> Any:
    try:
        return uniform_actions(space, NUM_ENVS, generator)
    except ValueError:  # another kind of space has its own way to sample
        space.seed(int(generator.integers(2**31)))
        return tuple(space.sample() for _ in range(NUM_ENVS))


def _take_in(digest: Any, value: Any) -> None:
    """Feed nested mappings and sequences of arrays into the hash, types and shapes included."""
    if isinstance(value, Mapping):
        for name in sorted(value):
            digest.update(name.encode())
            _take_in(digest, value[name])
    elif isinstance(value, tuple) or (isinstance(value, np.ndarray) and value.dtype == object):
        for part in value:
            _take_in(digest, part)
    elif value is not None:
        array = np.asarray(value)
        digest.update(f"{array.dtype.str}{array.shape}".encode())
        rounded = np.round(array, DECIMALS) + 0.0 if array.dtype.kind == "f" else array
        digest.update(np.ascontiguousarray(rounded).tobytes())
