"""What Stable-Baselines3's interface costs on an engine, and what the engine gains over its own vector environment.

All contenders take turns in one process with random actions, and the times are the processor's. Each info of the
interface is a dict of its own, so the adapter cannot be as fast as the engine.
"""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np

from benchmarks.measure import Row
from benchmarks.overhead import rates, row
from benchmarks.turns import Turn
from sprl_bench.extras import require_extra

TASK = "SPRL/FourRooms-7x7-v1"
STEPS = 40_000  # of all sub-environments, in a turn
OWN_STEPS = 2_000  # the same for DummyVecEnv, which is slow
BAR, GAIN_BAR = 0.4, 5.0
REPEATS = 9


def rows() -> list[Row]:
    """Measure all rows; takes half a minute."""
    return [*(_beside_engine(number) for number in (8, 128, 1024)), _beside_their_own(8)]


def engine(num_envs: int) -> Turn:
    """Return turns of a bare engine."""
    envs = gymnasium.make_vec(TASK, num_envs=num_envs, num_threads=1)
    envs.reset(seed=0)
    actions = _actions(num_envs)

    def turn() -> int:
        steps = max(1, STEPS // num_envs)
        for step in range(steps):
            envs.step(actions[step % len(actions)])
        return steps * num_envs

    return turn


def adapter(num_envs: int) -> Turn:
    """Return turns of an engine behind the adapter."""
    as_vec_env = require_extra("sprl_bench.sb3").as_vec_env
    return _turns(as_vec_env(gymnasium.make_vec(TASK, num_envs=num_envs, num_threads=1)), STEPS)


def their_own(num_envs: int) -> Turn:
    """Return turns of Stable-Baselines3's `DummyVecEnv`."""
    vec_env = require_extra("stable_baselines3.common.vec_env")
    return _turns(vec_env.DummyVecEnv([lambda: gymnasium.make(TASK)] * num_envs), OWN_STEPS)


def _turns(envs: Any, work: int) -> Turn:
    envs.seed(0)
    envs.reset()
    num_envs: int = envs.num_envs
    actions = _actions(num_envs)

    def turn() -> int:
        steps = max(1, work // num_envs)
        for step in range(steps):
            envs.step(actions[step % len(actions)])
        return steps * num_envs

    return turn


def _actions(num_envs: int) -> np.ndarray:
    """Return random actions of 64 steps, [64, N]."""
    return np.random.default_rng(0).integers(0, 7, (64, num_envs))


def _beside_engine(number: int) -> Row:
    ours, theirs = rates([adapter(number), engine(number)], REPEATS)
    return row(f"as_vec_env, {number:,} FourRooms 7x7", ours, "the bare engine", theirs, BAR)


def _beside_their_own(number: int) -> Row:
    ours, theirs = rates([adapter(number), their_own(number)], REPEATS)
    return row(f"as_vec_env, {number:,} FourRooms 7x7", ours, "DummyVecEnv of single ones", theirs, GAIN_BAR)
