"""The grid tasks as compiled kernels: N sub-environments in arrays, at most three cells touched a step.

A sub-environment is one row of each array:

- ``cells`` uint8 [N, S, S, 3]: the observation itself (row y, column x), kept up to date in place;
- ``agents`` int64 [N, 3]: x, y, direction;
- ``beneath`` uint8 [N, 3]: the cell that the agent stands on (empty, an open door, or the goal);
- ``carrying`` bool [N]: whether the agent holds the key;
- ``streams`` uint64 [N, 4]: its random stream.

The rules are Minigrid's. Kernels check no bounds: the outer wall keeps the agent inside.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sprl_bench.envs.grid import layouts
from sprl_bench.envs.grid.compiled import inline, kernel
from sprl_bench.envs.grid.encoding import (
    AGENT,
    CLOSED,
    DOOR,
    DOWN,
    DROP,
    EMPTY,
    FORWARD,
    GOAL,
    GREEN,
    GREY,
    HORIZON,
    KEY,
    LEFT,
    LOCKED,
    NUM_ACTIONS,
    OPEN,
    PICKUP,
    RED,
    RIGHT,
    TOGGLE,
    TURN_LEFT,
    TURN_RIGHT,
    UP,
    WALL,
    YELLOW,
)
from sprl_bench.envs.grid.layouts import (
    FOUR_ROOMS_DRAWS,
    KEY_DOORS_DRAWS,
    FourRoomsLayout,
    KeyDoorsLayout,
    four_rooms_layout,
    key_doors_layout,
)
from sprl_bench.envs.grid.streams import next_double

__all__ = ["advance", "first_invalid", "restart_four_rooms", "restart_key_doors"]

Cells = NDArray[np.uint8]

for function in (layouts.pick, layouts.pick_two, layouts.free_cell, four_rooms_layout, key_doors_layout):
    inline(function)


@inline
def _put(cell: Cells, kind: int, colour: int, state: int) -> None:
    cell[0], cell[1], cell[2] = kind, colour, state


@inline
def _room(cells: Cells) -> None:
    """Clear a grid and wall it in."""
    size = cells.shape[0]
    for y in range(size):
        for x in range(size):
            if x in (0, size - 1) or y in (0, size - 1):
                _put(cells[y, x], WALL, GREY, 0)
            else:
                _put(cells[y, x], EMPTY, 0, 0)


@inline
def _place(cells: Cells, agent: NDArray[np.int64], beneath: Cells, x: int, y: int, direction: int) -> None:
    """Put the agent on a grid."""
    agent[0], agent[1], agent[2] = x, y, direction
    beneath[:] = cells[y, x]
    _put(cells[y, x], AGENT, RED, direction)


@inline
def _paint_four_rooms(cells: Cells, layout: FourRoomsLayout) -> None:
    middle = cells.shape[0] // 2
    _room(cells)
    for index in range(cells.shape[0]):
        _put(cells[index, middle], WALL, GREY, 0)
        _put(cells[middle, index], WALL, GREY, 0)
    for y in (layout.gap_up, layout.gap_down):
        _put(cells[y, middle], EMPTY, 0, 0)
    for x in (layout.gap_left, layout.gap_right):
        _put(cells[middle, x], EMPTY, 0, 0)
    _put(cells[layout.goal_y, layout.goal_x], GOAL, GREEN, 0)


@inline
def _paint_key_doors(cells: Cells, layout: KeyDoorsLayout) -> None:
    _room(cells)
    for y in range(cells.shape[0]):
        _put(cells[y, layout.wall_x], WALL, GREY, 0)
    _put(cells[layout.door_y, layout.wall_x], DOOR, YELLOW, LOCKED)
    _put(cells[layout.key_y, layout.key_x], KEY, YELLOW, 0)
    _put(cells[layout.goal_y, layout.goal_x], GOAL, GREEN, 0)


@kernel
def restart_four_rooms(
    rows: NDArray[np.int64],
    cells: Cells,
    agents: NDArray[np.int64],
    beneath: Cells,
    carrying: NDArray[np.bool_],
    streams: NDArray[np.uint64],
) -> None:
    """Start a new episode of FourRooms in each of ``rows``."""
    uniforms = np.empty(FOUR_ROOMS_DRAWS)
    for row in rows:
        for draw in range(FOUR_ROOMS_DRAWS):
            uniforms[draw] = next_double(streams[row])
        layout = four_rooms_layout(cells.shape[1], uniforms)
        _paint_four_rooms(cells[row], layout)
        _place(cells[row], agents[row], beneath[row], layout.agent_x, layout.agent_y, layout.direction)
        carrying[row] = False


@kernel
def restart_key_doors(
    rows: NDArray[np.int64],
    cells: Cells,
    agents: NDArray[np.int64],
    beneath: Cells,
    carrying: NDArray[np.bool_],
    streams: NDArray[np.uint64],
) -> None:
    """Start a new episode of KeyDoors in each of ``rows``."""
    uniforms = np.empty(KEY_DOORS_DRAWS)
    for row in rows:
        for draw in range(KEY_DOORS_DRAWS):
            uniforms[draw] = next_double(streams[row])
        layout = key_doors_layout(cells.shape[1], uniforms)
        _paint_key_doors(cells[row], layout)
        _place(cells[row], agents[row], beneath[row], layout.agent_x, layout.agent_y, layout.direction)
        carrying[row] = False


@inline
def _turn(cells: Cells, agent: NDArray[np.int64], quarters: int) -> None:
    agent[2] = (agent[2] + quarters) % 4
    cells[agent[1], agent[0], 2] = agent[2]


@inline
def _forward(cells: Cells, agent: NDArray[np.int64], beneath: Cells, x: int, y: int) -> bool:
    """Move the agent to (x, y) if it can stand there; return whether that is the goal."""
    kind, state = cells[y, x, 0], cells[y, x, 2]
    if kind in (EMPTY, GOAL) or (kind == DOOR and state == OPEN):
        cells[agent[1], agent[0]] = beneath
        _place(cells, agent, beneath, x, y, agent[2])
    return kind == GOAL


@inline
def _handle(cell: Cells, carrying: bool, action: int) -> bool:
    """Pick up, drop or toggle at the cell in front; return whether the agent then holds the key."""
    kind, state = cell[0], cell[2]
    if action == PICKUP and kind == KEY and not carrying:
        _put(cell, EMPTY, 0, 0)
        return True
    if action == DROP and kind == EMPTY and carrying:
        _put(cell, KEY, YELLOW, 0)
        return False
    if action == TOGGLE and kind == DOOR and (state != LOCKED or carrying):
        cell[2] = CLOSED if state == OPEN else OPEN
    return carrying


@inline
def _step_one(
    row: int,
    action: int,
    cells: Cells,
    agents: NDArray[np.int64],
    beneath: Cells,
    carrying: NDArray[np.bool_],
) -> bool:
    """Take one action in one sub-environment; return whether the agent reached the goal."""
    agent = agents[row]
    if action == TURN_LEFT:
        _turn(cells[row], agent, 3)
    elif action == TURN_RIGHT:
        _turn(cells[row], agent, 1)
    else:
        direction = agent[2]
        x = agent[0] + (direction == RIGHT) - (direction == LEFT)
        y = agent[1] + (direction == DOWN) - (direction == UP)
        if action == FORWARD:
            return _forward(cells[row], agent, beneath[row], x, y)
        carrying[row] = _handle(cells[row, y, x], carrying[row], action)
    return False


@kernel
def advance(
    start: int,
    stop: int,
    actions: NDArray[np.int64],
    skipped: NDArray[np.bool_],
    elapsed: NDArray[np.int64],
    cells: Cells,
    agents: NDArray[np.int64],
    beneath: Cells,
    carrying: NDArray[np.bool_],
    rewards: NDArray[np.float64],
    terminations: NDArray[np.bool_],
    truncations: NDArray[np.bool_],
) -> None:
    """Step the sub-environments from ``start`` to ``stop``; the skipped ones stand still with reward 0.

    ``elapsed`` already counts this step.
    """
    for row in range(start, stop):
        reached = False
        if not skipped[row]:
            reached = _step_one(row, actions[row], cells, agents, beneath, carrying)
        rewards[row] = 1 - 0.9 * (elapsed[row] / HORIZON) if reached else 0.0
        terminations[row] = reached
        truncations[row] = not reached and not skipped[row] and elapsed[row] >= HORIZON


@kernel
def first_invalid(actions: NDArray[np.int64], skipped: NDArray[np.bool_]) -> int:
    """Return the first row whose action is out of range and not skipped, or -1."""
    for row in range(actions.shape[0]):
        if (actions[row] < 0 or actions[row] >= NUM_ACTIONS) and not skipped[row]:
            return row
    return -1
