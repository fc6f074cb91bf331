"""What Stable-Baselines3's interface costs on an engine, and what the engine gains over its own vector environment.

All contenders take turns in one process, and the times are the processor's. Each info of the interface is a dict of its
own, so random actions show the adapter slower than the engine. In a training that is little: the last rows compare PPO
on the adapter with the same training less the time that the adapter takes beside the engine's.
"""

from __future__ import annotations

import time
from collections.abc import Callable
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
BAR, GAIN_BAR, TRAINING_BAR = 0.4, 5.0, 0.95
REPEATS, TRAINING_REPEATS = 9, 5
ROLLOUT = 128  # steps of each sub-environment before an update


def rows() -> list[Row]:
    """Measure all rows; takes a minute."""
    return [
        *(_beside_engine(number) for number in (8, 128, 1024)),
        _beside_their_own(8),
        *(_in_training(number) for number in (8, 128, 1024)),
    ]


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


def training(num_envs: int) -> tuple[Turn, Timed]:
    """Return turns of Stable-Baselines3's PPO, each a rollout and its update, and the time in the adapter alone."""
    as_vec_env, ppo = require_extra("sprl_bench.sb3").as_vec_env, require_extra("stable_baselines3").PPO
    engine: Any = gymnasium.make_vec(TASK, num_envs=num_envs, num_threads=1, observation="flat")
    envs: Any = as_vec_env(engine)
    inner = Timed(engine.step)
    outer = Timed(envs.step_wait, inner)
    engine.step, envs.step_wait = inner, outer
    work = ROLLOUT * num_envs
    learner = ppo("MlpPolicy", envs, n_steps=ROLLOUT, batch_size=work // 4, n_epochs=4, device="cpu", seed=0)

    def turn() -> int:
        outer.seconds = inner.seconds = 0.0
        learner.learn(work, reset_num_timesteps=False)
        return work

    return turn, outer


class Timed:
    """A function, and the processor's time in it that it does not spend in another one."""

    def __init__(self, function: Callable[..., Any], inner: Timed | None = None) -> None:
        self.function = function
        self.inner = inner
        self.seconds = 0.0

    def __call__(self, *arguments: Any) -> Any:
        """Call the function."""
        before = time.process_time()
        result = self.function(*arguments)
        self.seconds += time.process_time() - before
        return result

    @property
    def alone(self) -> float:
        """The seconds less those of the inner function."""
        return self.seconds - (self.inner.seconds if self.inner else 0.0)


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


def _in_training(number: int) -> Row:
    turn, adapter_time = training(number)
    turn()
    ours, without = [], []
    for _ in range(TRAINING_REPEATS):
        before = time.process_time()
        steps = turn()
        seconds = time.process_time() - before
        ours.append(steps / seconds)
        without.append(steps / (seconds - adapter_time.alone))
    return row(f"PPO of SB3 on as_vec_env, {number:,}", ours, "the same less the adapter", without, TRAINING_BAR)
