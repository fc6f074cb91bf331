"""The motion of the agent: fixed-point arithmetic, so that all processors agree.

Lengths are in 1/65,536 of a cell, angles are directions of `directions`. A pose is (x, y, angle, speed x, speed y).

In each frame the velocity closes a quarter of its gap to the wanted velocity, which has the top speed in the direction
of the action, or is 0: so the agent starts and stops smoothly, and reaches two thirds of its top speed within an
action. The agent is a square of 30 units. At a wall it loses the speed across it and keeps the one along it.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from sprl_bench.envs.compiled import inline
from sprl_bench.envs.maze.directions import COSINES, DIRECTIONS, SCALE_BITS, SINES
from sprl_bench.envs.maze.levels import (
    BACK,
    FORWARD,
    FRAMES_A_SECOND,
    LOOK_LEFT,
    LOOK_LEFT_FORWARD,
    LOOK_RIGHT,
    LOOK_RIGHT_FORWARD,
    STRAFE_LEFT,
    STRAFE_RIGHT,
    UNITS_A_CELL,
    WALL,
)

Cells = NDArray[np.uint8]
Integers = NDArray[np.int64]

CELL_BITS: Final = 16
CELL: Final = 1 << CELL_BITS
TOP_SPEED: Final = 320 * CELL // (UNITS_A_CELL * FRAMES_A_SECOND)  # 320 units a second, for a frame
TURN: Final = 24  # directions a frame: 8.4 degrees an action
HALF_WIDTH: Final = 15 * CELL // UNITS_A_CELL
REACH: Final = 30 * CELL // UNITS_A_CELL
"""A thing is taken when the agent's centre is this close to its own."""

_ROUND: Final = 1 << SCALE_BITS - 1


@inline
def turn_of(action: int) -> int:
    """Return the change of the angle in one frame."""
    if action in (LOOK_LEFT, LOOK_LEFT_FORWARD):
        return -TURN
    if action in (LOOK_RIGHT, LOOK_RIGHT_FORWARD):
        return TURN
    return 0


@inline
def wanted_velocity(action: int, angle: int) -> tuple[int, int]:
    """Return the velocity (x, y) that an action aims at, per frame."""
    ahead, aside = 0, 0
    if action in (FORWARD, LOOK_LEFT_FORWARD, LOOK_RIGHT_FORWARD):
        ahead = TOP_SPEED
    elif action == BACK:
        ahead = -TOP_SPEED
    elif action == STRAFE_LEFT:
        aside = -TOP_SPEED
    elif action == STRAFE_RIGHT:
        aside = TOP_SPEED
    cosine, sine = COSINES[angle], SINES[angle]
    across, down = ahead * cosine - aside * sine, ahead * sine + aside * cosine
    return (across + _ROUND) >> SCALE_BITS, (down + _ROUND) >> SCALE_BITS


@inline
def eased(speed: int, wanted: int) -> int:
    """Return the speed along one axis after one frame."""
    gap = wanted - speed
    if abs(gap) < 4:
        return wanted
    return speed + (gap // 4 if gap > 0 else -(-gap // 4))


@inline
def _is_blocked(cells: Cells, row: int, first_x: int, last_x: int, first_y: int, last_y: int) -> bool:
    """Return whether a rectangle of two opposite corners touches a wall; it is at most one cell wide and high."""
    left, right, top, bottom = first_x >> CELL_BITS, last_x >> CELL_BITS, first_y >> CELL_BITS, last_y >> CELL_BITS
    above = cells[row, top, left] == WALL or cells[row, top, right] == WALL
    return bool(above or cells[row, bottom, left] == WALL or cells[row, bottom, right] == WALL)


@inline
def stopped(coordinate: int, speed: int) -> int:
    """Return where the agent touches the wall that it would enter by moving to `coordinate`."""
    if speed > 0:
        return ((coordinate + HALF_WIDTH) >> CELL_BITS << CELL_BITS) - HALF_WIDTH - 1
    return (((coordinate - HALF_WIDTH) >> CELL_BITS) + 1 << CELL_BITS) + HALF_WIDTH


@inline
def move(cells: Cells, poses: Integers, row: int, action: int) -> None:
    """Move the agent of one row by one frame: turn, change speed, and slide along x, then y."""
    angle = (poses[row, 2] + turn_of(action)) % DIRECTIONS
    wanted_x, wanted_y = wanted_velocity(action, angle)
    speed_x, speed_y = eased(poses[row, 3], wanted_x), eased(poses[row, 4], wanted_y)
    x, y = poses[row, 0] + speed_x, poses[row, 1]
    if is_inside_wall(cells, row, x, y):
        x, speed_x = stopped(x, speed_x), 0
    y += speed_y
    if is_inside_wall(cells, row, x, y):
        y, speed_y = stopped(y, speed_y), 0
    poses[row, 0], poses[row, 1], poses[row, 2], poses[row, 3], poses[row, 4] = x, y, angle, speed_x, speed_y


@inline
def is_inside_wall(cells: Cells, row: int, x: int, y: int) -> bool:
    """Return whether an agent at (x, y) overlaps a wall."""
    return _is_blocked(cells, row, x - HALF_WIDTH, x + HALF_WIDTH, y - HALF_WIDTH, y + HALF_WIDTH)
