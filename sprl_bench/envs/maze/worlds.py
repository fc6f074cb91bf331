"""N mazes in arrays. The single environment is the case N = 1."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sprl_bench.envs.maze.raycast import LOOK_VALUES
from sprl_bench.envs.streams import STREAM_LIMBS

Cells = NDArray[np.uint8]
Integers = NDArray[np.int64]
Flags = NDArray[np.bool_]
Streams = NDArray[np.uint64]


class Worlds(NamedTuple):
    """The state of N mazes, and what follows from it."""

    layouts: Integers  # [N] index in the bank
    poses: Integers  # [N, 5] x, y, angle, speed x, speed y (see `motion`)
    things: Integers  # [N, T, 3] x, y, kind
    looks: Integers  # [N, LOOK_VALUES] (see `raycast`)
    is_success: Flags  # [N] whether the episode has paid a positive reward
    streams: Streams  # [N, STREAM_LIMBS]
    cells: Cells  # [N, S, S], of the layout
    distances: Integers  # [N, S, S] from each cell to the nearest goal or good object, in cells

    def state(self) -> dict[str, NDArray[np.generic]]:
        """Return the arrays that the others follow from, by name."""
        return {name: getattr(self, name) for name in self._fields[:6]}


class Rules(NamedTuple):
    """What the compiled functions need to know about the level and the arguments of the environment."""

    horizon: int
    minimum_goal_distance: int
    fog: bool


def new_worlds(num_envs: int, size: int, num_things: int) -> Worlds:
    """Allocate N mazes of S x S cells with T things."""
    return Worlds(
        layouts=np.zeros(num_envs, np.int64),
        poses=np.zeros((num_envs, 5), np.int64),
        things=np.zeros((num_envs, num_things, 3), np.int64),
        looks=np.zeros((num_envs, LOOK_VALUES), np.int64),
        is_success=np.zeros(num_envs, np.bool_),
        streams=np.zeros((num_envs, STREAM_LIMBS), np.uint64),
        cells=np.zeros((num_envs, size, size), np.uint8),
        distances=np.zeros((num_envs, size, size), np.int64),
    )
