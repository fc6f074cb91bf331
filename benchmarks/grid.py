"""The batched grid engine against Minigrid in SyncVectorEnv, against EnvPool's nearest task, and against NAVIX.

Everyone takes uniformly random actions, restarts what has ended within the step, and returns whole batches.
"""

from __future__ import annotations

import os
import sys
from functools import partial
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import SyncVectorEnv
from minigrid.core.mission import MissionSpace
from minigrid.envs import FourRoomsEnv
from minigrid.minigrid_env import MiniGridEnv
from minigrid.wrappers import FullyObsWrapper, ImgObsWrapper

import sprl_bench  # noqa: F401 - registers the ids
from benchmarks import navix_rooms
from benchmarks.contenders import Contender, contender, optional
from benchmarks.measure import Row, compare
from benchmarks.turns import Turn

TASK = "SPRL/FourRooms-7x7-v1"


class SmallFourRooms(FourRoomsEnv):  # type: ignore[misc]  # minigrid ships no types
    """Minigrid's own FourRooms, whose size of 19 is fixed in its constructor, at our size; nothing else is changed."""

    def __init__(self) -> None:
        self._agent_default_pos = self._goal_default_pos = None
        MiniGridEnv.__init__(self, MissionSpace(self._gen_mission), grid_size=7, max_steps=100)


def rows() -> list[Row]:
    """Measure all rows; takes a few minutes."""
    return [_against_minigrid(), _against_envpool(), _against_navix()]


def _against_minigrid() -> Row:
    return compare(
        _what(1024, 1),
        contender(ours, num_envs=1024, num_threads=1, steps=1000),
        "minigrid FourRooms 7x7, full observation, SyncVectorEnv",
        contender(minigrid, num_envs=1024, steps=2),
        bar=1000,
    )


def _against_envpool() -> Row:
    return compare(
        _what(64, 2),
        contender(ours, num_envs=64, num_threads=2, steps=10_000),
        "EnvPool MiniGrid-FourRooms-v0 (19x19, egocentric view), 2 threads",
        optional("envpool", "envpool", pool, num_envs=64, num_threads=2, steps=500),
        bar=10,
    )


def _against_navix() -> Row:
    return compare(
        _what(1024, 1),
        contender(ours, num_envs=1024, num_threads=1, steps=1000),
        f"NAVIX {navix_rooms.TASK}, full observation, JIT-compiled, N=1024, 1 core",
        navix(num_envs=1024, steps=100),
        bar=3,
    )


def _what(num_envs: int, num_threads: int) -> str:
    return f"FourRooms 7x7, N={num_envs}, {num_threads} thread" + "s" * (num_threads > 1)


def ours(num_envs: int, num_threads: int, steps: int) -> Turn:
    """Return turns of our engine."""
    return _stepper(gymnasium.make_vec(TASK, num_envs, num_threads=num_threads), num_envs, steps)


def minigrid(num_envs: int, steps: int) -> Turn:
    """Return turns of Minigrid in its fastest form: no wrappers of `gymnasium.make`, no mission in the observation."""
    make = [lambda: ImgObsWrapper(FullyObsWrapper(SmallFourRooms()))]
    envs: Any = SyncVectorEnv(make * num_envs, autoreset_mode="SameStep")
    return _stepper(envs, num_envs, steps)


def pool(num_envs: int, num_threads: int, steps: int) -> Turn:
    """Return turns of EnvPool."""
    import envpool  # noqa: PLC0415 - optional

    envs = envpool.make_gymnasium("MiniGrid-FourRooms-v0", num_envs=num_envs, num_threads=num_threads)
    return _stepper(envs, num_envs, steps)


def navix(num_envs: int, steps: int) -> Contender:
    """Return NAVIX in the environment that `make bench` gives it, beside the one of this interpreter."""
    python = os.environ.get("NAVIX_PYTHON", f"{sys.prefix}-navix/bin/python")
    lacks = "" if Path(python).exists() else "Python 3.12: where it runs, `make bench` installs NAVIX"
    return Contender(navix_rooms.random_steps, {"num_envs": num_envs, "steps": steps}, python, lacks)


def _stepper(envs: Any, num_envs: int, steps: int) -> Turn:
    """Return turns of `steps` vector steps with actions drawn beforehand."""
    actions = list(np.random.default_rng(0).integers(7, size=(steps, num_envs)))
    envs.reset()
    return partial(_run, envs, actions)


def _run(envs: Any, actions: list[np.ndarray[Any, Any]]) -> int:
    for action in actions:
        envs.step(action)
    return sum(map(len, actions))
