"""The batched grid engine against Minigrid in SyncVectorEnv, and against EnvPool's nearest task.

Everyone takes uniformly random actions, restarts what has ended within the step, and returns whole batches.
"""

from __future__ import annotations

import importlib.util
from functools import partial
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import SyncVectorEnv
from minigrid.core.mission import MissionSpace
from minigrid.envs import FourRoomsEnv
from minigrid.minigrid_env import MiniGridEnv
from minigrid.wrappers import FullyObsWrapper, ImgObsWrapper

import sprl_bench  # noqa: F401 - registers the ids
from benchmarks.measure import Contender, Row, compare, missing, table

TASK = "SPRL/FourRooms-7x7-v1"


class SmallFourRooms(FourRoomsEnv):  # type: ignore[misc]  # minigrid ships no types
    """Minigrid's own FourRooms, whose size of 19 is fixed in its constructor, at our size; nothing else is changed."""

    def __init__(self) -> None:
        self._agent_default_pos = self._goal_default_pos = None
        MiniGridEnv.__init__(self, MissionSpace(self._gen_mission), grid_size=7, max_steps=100)


def rows() -> list[Row]:
    """Measure both rows; takes about a minute."""
    return [_against_minigrid(), _against_envpool()]


def main() -> None:
    """Print the table."""
    print(table(rows()))


def _against_minigrid() -> Row:
    num_envs = 1024
    ours = gymnasium.make_vec(TASK, num_envs, num_threads=1)
    # Without the wrappers of gymnasium.make, and without the mission text in the observation: their fastest form.
    theirs: Any = SyncVectorEnv(
        [lambda: ImgObsWrapper(FullyObsWrapper(SmallFourRooms()))] * num_envs, autoreset_mode="SameStep"
    )
    return compare(
        f"FourRooms 7x7, N={num_envs}, 1 thread",
        _stepper(ours, num_envs, steps=1000),
        "minigrid FourRooms 7x7, full observation, SyncVectorEnv",
        _stepper(theirs, num_envs, steps=2),
        bar=1000,
    )


def _against_envpool() -> Row:
    num_envs, num_threads, bar = 64, 2, 10
    what = f"FourRooms 7x7, N={num_envs}, {num_threads} threads"
    against = f"EnvPool MiniGrid-FourRooms-v0 (19x19, egocentric view), {num_threads} threads"
    if importlib.util.find_spec("envpool") is None:
        return missing(what, against, bar=bar)
    import envpool  # noqa: PLC0415 - optional

    ours = gymnasium.make_vec(TASK, num_envs, num_threads=num_threads)
    theirs = envpool.make_gymnasium("MiniGrid-FourRooms-v0", num_envs=num_envs, num_threads=num_threads)
    return compare(
        what, _stepper(ours, num_envs, steps=10_000), against, _stepper(theirs, num_envs, steps=500), bar=bar
    )


def _stepper(envs: Any, num_envs: int, steps: int) -> Contender:
    """Return work of ``steps`` vector steps with actions drawn beforehand."""
    actions = list(np.random.default_rng(0).integers(7, size=(steps, num_envs)))
    envs.reset()
    return partial(_run, envs, actions)


def _run(envs: Any, actions: list[np.ndarray[Any, Any]]) -> int:
    for action in actions:
        envs.step(action)
    return sum(map(len, actions))


if __name__ == "__main__":
    main()
