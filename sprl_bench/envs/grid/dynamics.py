"""The grid tasks as compiled kernels: N sub-environments in arrays; a step changes at most three cells.

A sub-environment is one row of each array:

- `cells` uint8 [N, S, S, 3]: the observation itself (row y, column x), updated in place;
- `agents` int64 [N, 3]: x, y, direction;
- `beneath` uint8 [N, 3]: the cell that the agent stands on (empty, an open door, or the goal);
- `carrying` bool [N]: whether the agent holds the key;
- `streams` uint64 [N, 4]: its random stream.

The rules are Minigrid's. Kernels do not check bounds: the outer wall keeps the agent inside. They index whole arrays
by row, because making a view of a row would take longer than the work on it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sprl_bench.envs.compiled import inline, kernel
from sprl_bench.envs.grid import layouts
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
from sprl_bench.envs.streams import next_double

Cells = NDArray[np.uint8]
Integers = NDArray[np.int64]
Flags = NDArray[np.bool_]

for function in (layouts.pick, layouts.pick_two, layouts.free_cell, four_rooms_layout, key_doors_layout):
    inline(function)


@inline
def _put(cells: Cells, row: int, y: int, x: int, kind: int, colour: int, state: int) -> None:
    cells[row, y, x, 0], cells[row, y, x, 1], cells[row, y, x, 2] = kind, colour, state


@inline
def _room(cells: Cells, row: int) -> None:
    """Clear a grid and put walls around it."""
    size = cells.shape[1]
    for y in range(size):
        for x in range(size):
            if x in (0, size - 1) or y in (0, size - 1):
                _put(cells, row, y, x, WALL, GREY, 0)
            else:
                _put(cells, row, y, x, EMPTY, 0, 0)


@inline
def _paint_four_rooms(cells: Cells, row: int, layout: FourRoomsLayout) -> None:
    middle = cells.shape[1] // 2
    _room(cells, row)
    for index in range(cells.shape[1]):
        _put(cells, row, index, middle, WALL, GREY, 0)
        _put(cells, row, middle, index, WALL, GREY, 0)
    _put(cells, row, layout.gap_up, middle, EMPTY, 0, 0)
    _put(cells, row, layout.gap_down, middle, EMPTY, 0, 0)
    _put(cells, row, middle, layout.gap_left, EMPTY, 0, 0)
    _put(cells, row, middle, layout.gap_right, EMPTY, 0, 0)
    _put(cells, row, layout.goal_y, layout.goal_x, GOAL, GREEN, 0)


@inline
def _paint_key_doors(cells: Cells, row: int, layout: KeyDoorsLayout) -> None:
    _room(cells, row)
    for y in range(cells.shape[1]):
        _put(cells, row, y, layout.wall_x, WALL, GREY, 0)
    _put(cells, row, layout.door_y, layout.wall_x, DOOR, YELLOW, LOCKED)
    _put(cells, row, layout.key_y, layout.key_x, KEY, YELLOW, 0)
    _put(cells, row, layout.goal_y, layout.goal_x, GOAL, GREEN, 0)


@inline
def _place(cells: Cells, agents: Integers, beneath: Cells, row: int, x: int, y: int, direction: int) -> None:
    """Put the agent on a cell, and store the cell in `beneath`."""
    for channel in range(3):
        beneath[row, channel] = cells[row, y, x, channel]
    _put(cells, row, y, x, AGENT, RED, direction)
    agents[row, 0], agents[row, 1], agents[row, 2] = x, y, direction


@inline
def _draw(streams: NDArray[np.uint64], row: int, uniforms: NDArray[np.float64]) -> None:
    """Fill `uniforms` with the next doubles of one stream."""
    stream = streams[row]
    for index in range(uniforms.shape[0]):
        uniforms[index] = next_double(stream)


@kernel
def restart_four_rooms(
    rows: Integers, cells: Cells, agents: Integers, beneath: Cells, carrying: Flags, streams: NDArray[np.uint64]
) -> None:
    """Start a new episode of FourRooms in each of `rows`."""
    uniforms = np.empty(FOUR_ROOMS_DRAWS)
    for row in rows:
        _draw(streams, row, uniforms)
        layout = four_rooms_layout(cells.shape[1], uniforms)
        _paint_four_rooms(cells, row, layout)
        _place(cells, agents, beneath, row, layout.agent_x, layout.agent_y, layout.direction)
        carrying[row] = False


@kernel
def restart_key_doors(
    rows: Integers, cells: Cells, agents: Integers, beneath: Cells, carrying: Flags, streams: NDArray[np.uint64]
) -> None:
    """Start a new episode of KeyDoors in each of `rows`."""
    uniforms = np.empty(KEY_DOORS_DRAWS)
    for row in rows:
        _draw(streams, row, uniforms)
        layout = key_doors_layout(cells.shape[1], uniforms)
        _paint_key_doors(cells, row, layout)
        _place(cells, agents, beneath, row, layout.agent_x, layout.agent_y, layout.direction)
        carrying[row] = False


@inline
def _turned(direction: int, action: int) -> int:
    """Return the direction after a turn."""
    return (direction + (1 if action == TURN_RIGHT else 3)) % 4


@inline
def _ahead(x: int, y: int, direction: int) -> tuple[int, int]:
    """Return (x, y) of the cell in front of a pose."""
    return x + (direction == RIGHT) - (direction == LEFT), y + (direction == DOWN) - (direction == UP)


@inline
def _can_enter(kind: int, state: int) -> bool:
    """Return whether the agent can stand on a cell."""
    return kind == EMPTY or kind == GOAL or (kind == DOOR and state == OPEN)  # noqa: PLR1714 - "in" is slower


@inline
def _handled(kind: int, colour: int, state: int, carrying: bool, action: int) -> tuple[int, int, int, bool]:
    """Return a cell, and whether the agent holds the key, after pickup, drop or toggle there."""
    if action == PICKUP and kind == KEY and not carrying:
        return EMPTY, 0, 0, True
    if action == DROP and kind == EMPTY and carrying:
        return KEY, YELLOW, 0, False
    if action == TOGGLE and kind == DOOR and (state != LOCKED or carrying):
        return kind, colour, CLOSED if state == OPEN else OPEN, carrying
    return kind, colour, state, carrying


@kernel
def advance(
    start: int,
    stop: int,
    actions: Integers,
    skipped: Flags,
    elapsed: Integers,
    cells: Cells,
    agents: Integers,
    beneath: Cells,
    carrying: Flags,
    rewards: NDArray[np.float64],
    terminations: Flags,
    truncations: Flags,
) -> None:
    """Step the sub-environments from `start` to `stop`; skipped ones do not change and get reward 0.

    `elapsed` already includes this step.
    """
    # One long body: functions called here only take numbers, because passing arrays takes longer than a whole step.
    for row in range(start, stop):
        action, reached = actions[row], False
        x, y, direction = agents[row, 0], agents[row, 1], agents[row, 2]
        ahead_x, ahead_y = _ahead(x, y, direction)
        kind = cells[row, ahead_y, ahead_x, 0]
        colour, state = cells[row, ahead_y, ahead_x, 1], cells[row, ahead_y, ahead_x, 2]
        if skipped[row]:
            pass
        elif action in (TURN_LEFT, TURN_RIGHT):
            agents[row, 2] = cells[row, y, x, 2] = _turned(direction, action)
        elif action != FORWARD:
            kind, colour, state, carrying[row] = _handled(kind, colour, state, carrying[row], action)
            _put(cells, row, ahead_y, ahead_x, kind, colour, state)
        elif _can_enter(kind, state):
            _put(cells, row, y, x, beneath[row, 0], beneath[row, 1], beneath[row, 2])
            _put(cells, row, ahead_y, ahead_x, AGENT, RED, direction)
            beneath[row, 0], beneath[row, 1], beneath[row, 2] = kind, colour, state
            agents[row, 0], agents[row, 1] = ahead_x, ahead_y
            reached = kind == GOAL
        rewards[row] = 1 - 0.9 * (elapsed[row] / HORIZON) if reached else 0.0
        terminations[row] = reached
        truncations[row] = elapsed[row] >= HORIZON and not (reached or skipped[row])
