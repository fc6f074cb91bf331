"""Shortest paths on the cells of a maze, from each cell to the nearest thing that is worth taking."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from sprl_bench.envs.compiled import kernel
from sprl_bench.envs.maze.levels import GOAL, GOOD, WALL

Cells = NDArray[np.uint8]
Integers = NDArray[np.int64]

UNREACHED: Final = -1


@kernel
def measure(cells: Cells, things: Integers, row: int, distances: Integers) -> None:
    """Fill `distances[row]` [S, S] with the steps from cell to cell to the nearest goal or good object.

    Args:
        cells: uint8 [N, S, S].
        things: int64 [N, T, 3]: x, y, kind.
        row: Which maze.
        distances: int64 [N, S, S]; walls, and all cells if there is nothing to reach, get `UNREACHED`.
    """
    size = cells.shape[1]
    queue = np.empty(size * size, np.int64)
    for cell in range(size * size):
        distances[row, cell // size, cell % size] = UNREACHED
    head, tail = 0, 0
    for thing in range(things.shape[1]):
        x, y, kind = things[row, thing, 0], things[row, thing, 1], things[row, thing, 2]
        if kind in (GOAL, GOOD):
            distances[row, y, x] = 0
            queue[tail] = y * size + x
            tail += 1
    while head < tail:
        y, x = queue[head] // size, queue[head] % size
        head += 1
        for side in range(4):
            next_x, next_y = x + (side == 0) - (side == 2), y + (side == 1) - (side == 3)
            if cells[row, next_y, next_x] != WALL and distances[row, next_y, next_x] == UNREACHED:
                distances[row, next_y, next_x] = distances[row, y, x] + 1
                queue[tail] = next_y * size + next_x
                tail += 1
