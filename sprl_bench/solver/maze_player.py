"""A competent player of the mazes: exact shortest paths on the cells, and the next action towards the next cell.

It knows the whole maze, so an agent that uses it is privileged. It walks around bad objects where it can.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from sprl_bench.envs.maze.cell_paths import UNREACHED, measure
from sprl_bench.envs.maze.directions import COSINES, SINES
from sprl_bench.envs.maze.levels import (
    BAD,
    FORWARD,
    LOOK_LEFT,
    LOOK_LEFT_FORWARD,
    LOOK_RIGHT,
    LOOK_RIGHT_FORWARD,
    WALL,
)
from sprl_bench.envs.maze.mazes import Mazes
from sprl_bench.envs.maze.motion import CELL, CELL_BITS

Integers = NDArray[np.int64]

_NEIGHBOURS: Final = np.array([(0, 0), (1, 0), (0, 1), (-1, 0), (0, -1)])  # x, y; the agent's own cell first
_FAR: Final = 1 << 30
_STRAIGHT: Final = 13  # turn where the target is more than 1/13 radians, half a turn of one action, off the direction


def maze_distances(mazes: Mazes) -> Integers:
    """Return the cells on the shortest path from each cell, int64 [N, S, S], to the goal or nearest good object.

    Walls have -1. Paths avoid the cells of bad objects, except from cells from which only such a path exists.

    Args:
        mazes: Those of an environment or an engine: `env.unwrapped.mazes`.
    """
    worlds = mazes.worlds
    avoiding = worlds.cells.copy()
    row, thing = np.nonzero(worlds.things[..., 2] == BAD)
    x, y, _ = worlds.things[row, thing].T
    avoiding[row, y, x] = WALL
    distances = np.empty_like(worlds.distances)
    for index in range(len(distances)):
        measure(avoiding, worlds.things, index, distances)
    return np.where(distances == UNREACHED, worlds.distances, distances)


def maze_actions(mazes: Mazes) -> Integers:
    """Return the next action of a competent player, int64 [N]: turn towards the next cell of a shortest path, or walk.

    Args:
        mazes: Those of an environment or an engine: `env.unwrapped.mazes`.
    """
    poses = mazes.worlds.poses
    aim = _next_cells(maze_distances(mazes), poses) * CELL + CELL // 2 - poses[:, :2]
    cosine, sine = COSINES[poses[:, 2]], SINES[poses[:, 2]]
    ahead, aside = aim[:, 0] * cosine + aim[:, 1] * sine, aim[:, 1] * cosine - aim[:, 0] * sine
    look, walk = np.where(aside > 0, LOOK_RIGHT, LOOK_LEFT), np.where(aside > 0, LOOK_RIGHT_FORWARD, LOOK_LEFT_FORWARD)
    turning = np.where(ahead > abs(aside), walk, look)
    return np.where(ahead > _STRAIGHT * abs(aside), FORWARD, turning).astype(np.int64)


def _next_cells(distances: Integers, poses: Integers) -> Integers:
    """Return the cell (x, y), int64 [N, 2], that is nearest to the target among the agent's and its neighbours."""
    around = (poses[:, :2] >> CELL_BITS)[:, None] + _NEIGHBOURS
    found = distances[np.arange(len(poses))[:, None], around[..., 1], around[..., 0]]
    best = np.where(found == UNREACHED, _FAR, found).argmin(axis=1)
    chosen: Integers = around[np.arange(len(poses)), best]
    return chosen
