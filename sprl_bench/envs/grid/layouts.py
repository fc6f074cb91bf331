"""The layout of a new episode (walls, agent, objects): pure functions of one vector of uniform draws.

Each reset draws one vector of doubles in [0, 1) and decodes it here, by floor(u * n) for a choice among n. The
functions are plain Python that Numba can compile, so the single environment and the batched engine share them.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

FOUR_ROOMS_DRAWS: Final = 7
KEY_DOORS_DRAWS: Final = 6


class FourRoomsLayout(NamedTuple):
    """Four rooms around the cross of walls at `size // 2`."""

    gap_up: int  # row of the gap in the vertical wall's upper half
    gap_down: int  # row of the gap in its lower half
    gap_left: int  # column of the gap in the horizontal wall's left half
    gap_right: int  # column of the gap in its right half
    agent_x: int
    agent_y: int
    direction: int
    goal_x: int
    goal_y: int


class KeyDoorsLayout(NamedTuple):
    """Two rooms: agent and key to the left of a wall with one locked door, the goal to its right."""

    wall_x: int
    door_y: int
    agent_x: int
    agent_y: int
    direction: int
    key_x: int
    key_y: int
    goal_x: int
    goal_y: int


def pick(uniform: float, count: int) -> int:
    """Turn a draw from [0, 1) into a choice among 0 .. count - 1, all equally likely."""
    return int(uniform * count)


def pick_two(first_uniform: float, second_uniform: float, count: int) -> tuple[int, int]:
    """Turn two draws into two distinct choices among 0 .. count - 1, all ordered pairs equally likely."""
    first = pick(first_uniform, count)
    second = pick(second_uniform, count - 1)
    return first, second + (second >= first)


def four_rooms_layout(size: int, uniforms: Sequence[float] | NDArray[np.float64]) -> FourRoomsLayout:
    """Decode `FOUR_ROOMS_DRAWS` draws for an odd `size` of at least 5.

    Each gap is uniform over its wall segment, the agent over all free cells (gaps included) and directions, the
    goal over the other free cells.
    """
    middle = size // 2
    room = middle - 1  # rooms have room x room cells; wall segments have the same length
    gap_up = 1 + pick(uniforms[0], room)
    gap_down = middle + 1 + pick(uniforms[1], room)
    gap_left = 1 + pick(uniforms[2], room)
    gap_right = middle + 1 + pick(uniforms[3], room)
    gaps = ((middle, gap_up), (middle, gap_down), (gap_left, middle), (gap_right, middle))
    agent, goal = pick_two(uniforms[4], uniforms[6], 4 * room * room + 4)
    agent_x, agent_y = free_cell(agent, middle, gaps)
    goal_x, goal_y = free_cell(goal, middle, gaps)
    direction = pick(uniforms[5], 4)
    return FourRoomsLayout(gap_up, gap_down, gap_left, gap_right, agent_x, agent_y, direction, goal_x, goal_y)


def free_cell(index: int, middle: int, gaps: tuple[tuple[int, int], ...]) -> tuple[int, int]:
    """Return (x, y) of a free cell of four rooms, numbered room by room, then the four gaps."""
    room = middle - 1
    area = room * room
    if index >= 4 * area:
        return gaps[index - 4 * area]
    corner, cell = index // area, index % area
    return (corner % 2) * middle + 1 + cell % room, (corner // 2) * middle + 1 + cell // room


def key_doors_layout(size: int, uniforms: Sequence[float] | NDArray[np.float64]) -> KeyDoorsLayout:
    """Decode `KEY_DOORS_DRAWS` draws for a `size` of at least 5.

    The wall's column is uniform in [2, size - 3], the door's row in [1, size - 2]; agent and key take distinct
    cells on the left, the goal a cell on the right, each uniform.
    """
    height = size - 2
    wall_x = 2 + pick(uniforms[0], size - 4)
    door_y = 1 + pick(uniforms[1], height)
    agent, key = pick_two(uniforms[2], uniforms[4], (wall_x - 1) * height)
    direction = pick(uniforms[3], 4)
    goal = pick(uniforms[5], (size - 2 - wall_x) * height)
    return KeyDoorsLayout(
        wall_x, door_y,
        1 + agent // height, 1 + agent % height, direction,
        1 + key // height, 1 + key % height,
        wall_x + 1 + goal // height, 1 + goal % height,
    )  # fmt: skip
