"""Reads the full state of a grid task from an observation, and checks that it is a valid map."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sprl_bench.envs.compiled import inline, kernel
from sprl_bench.envs.grid.encoding import AGENT, DOOR, EMPTY, GOAL, KEY, LOCKED, OPEN, UP, WALL

Cells = NDArray[np.uint8]
Integers = NDArray[np.int64]

NOWHERE: Final = -1
_FAULTS: Final = (
    "",
    "its outer border is not all walls",
    "it holds an object that is neither empty, wall, door, key, goal nor agent",
    "the agent's direction is not in 0..3",
    "the door's state is not in 0..2",
    "it does not hold exactly one agent",
    "it holds more than one key, door or goal",
)
"""The faults of a map, by the number that `_fault` returns; 0 means none."""


class State(NamedTuple):
    """The full state of N grids. Cells are y * S + x."""

    agent: Integers  # [N] cell
    direction: Integers  # [N] 0 right, 1 down, 2 left, 3 up
    key: Integers  # [N] cell; S * S if carried, or if there is none
    door_state: Integers  # [N] 0 open, 1 closed, 2 locked; 0 if there is none
    door: Integers  # [N] cell, or -1 if there is none
    goal: Integers  # [N] cell


def parse(observations: Cells) -> State:
    """Read the full state from observations uint8 [N, S, S, 3]."""
    observations = checked_maps(observations)
    out = np.empty((6, len(observations)), np.int64)
    _parse_all(observations, out)
    return State(*out)


def checked_maps(observations: Cells, name: str = "observations") -> Cells:
    """Return observations in the memory layout of the compiled kernels, after checking that each is a valid map.

    Compiled code does not check indices: on a map without a border or an agent, it would read outside its arrays.
    """
    observations = np.asarray(observations)
    shape = observations.shape
    if observations.dtype != np.uint8 or len(shape) != 4 or shape[1] != shape[2] or shape[3] != 3:
        raise ValueError(f"{name} is {observations.dtype} {list(shape)}; it must be uint8 [N, S, S, 3].")
    observations = np.require(observations, requirements=["C", "W"])
    row, fault = _first_fault(observations)
    if fault:
        raise ValueError(f"{name}[{row}] is invalid: {_FAULTS[fault]}; it must be a map of a grid task.")
    return observations


@kernel
def _first_fault(observations: Cells) -> tuple[int, int]:
    """Return the first row that is not a valid map and the number of its fault; 0, 0 if all are valid."""
    for row in range(observations.shape[0]):
        fault = _fault(observations[row])
        if fault:
            return row, fault
    return 0, 0


@inline
def _fault(cells: Cells) -> int:
    """Return the fault of a map, as an index of `_FAULTS`.

    A map may have no goal and no door: the agent hides the object in its cell.
    """
    size = cells.shape[0]
    agents, keys, doors, goals = 0, 0, 0, 0
    for y in range(size):
        for x in range(size):
            kind, state = cells[y, x, 0], cells[y, x, 2]
            if kind == WALL:
                continue
            if y in (0, size - 1) or x in (0, size - 1):
                return 1
            if kind not in (EMPTY, DOOR, KEY, GOAL, AGENT):
                return 2
            if kind == AGENT and state > UP:
                return 3
            if kind == DOOR and state > LOCKED:
                return 4
            agents += kind == AGENT
            keys += kind == KEY
            doors += kind == DOOR
            goals += kind == GOAL
    if agents != 1:
        return 5
    return 6 if max(keys, doors, goals) > 1 else 0


@kernel
def _parse_all(observations: Cells, out: Integers) -> None:
    """Fill `out` [6, N]."""
    for index in range(observations.shape[0]):
        read_state(observations[index], out[:, index])


@inline
def read_state(cells: Cells, out: Integers) -> None:
    """Fill `out` with the fields of `State`."""
    size = cells.shape[0]
    area = size * size
    agent, direction, key, door_state, door, goal = NOWHERE, 0, area, OPEN, NOWHERE, NOWHERE
    for cell in range(area):
        kind, state = cells[cell // size, cell % size, 0], int(cells[cell // size, cell % size, 2])
        if kind == AGENT:
            agent, direction = cell, state
        elif kind == KEY:
            key = cell
        elif kind == DOOR:
            door, door_state = cell, state
        elif kind == GOAL:
            goal = cell
    if door == NOWHERE and _is_divided(cells):
        door = agent
    if goal == NOWHERE:
        goal = agent
    out[0], out[1], out[2], out[3], out[4], out[5] = agent, direction, key, door_state, door, goal


@inline
def _is_divided(cells: Cells) -> bool:
    """Return whether the inner walls are in one column, as in KeyDoors, and not in several, as in FourRooms."""
    size = cells.shape[0]
    columns = 0
    for x in range(1, size - 1):
        walls = 0
        for y in range(1, size - 1):
            walls += cells[y, x, 0] == WALL
        columns += walls > 0
    return columns == 1


@inline
def same_walls(cells: Cells, others: Cells) -> bool:
    """Return whether two maps of one size have the same walls."""
    for y in range(cells.shape[0]):
        for x in range(cells.shape[1]):
            if (cells[y, x, 0] == WALL) != (others[y, x, 0] == WALL):
                return False
    return True
