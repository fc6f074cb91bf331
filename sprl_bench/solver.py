"""The exact solver of the grid tasks: shortest paths and reachability on the full state, from observations alone.

The full state is the agent's pose, where the key is (a cell, or in hand) and the door's state. All of it can be
read from an observation: a key out of sight is in hand, a door out of sight is open and under the agent, a goal
out of sight is under the agent and ends the episode. FourRooms has neither key nor door.

Everything takes and gives arrays. Time is counted in env steps; -1 stands for "no way". Breadth-first search does
the work, with one integer for a state, so that the answers are exact and not the product of a heuristic.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sprl_bench.envs.arguments import check_integer
from sprl_bench.envs.grid.compiled import inline, kernel
from sprl_bench.envs.grid.encoding import (
    AGENT,
    CLOSED,
    DONE,
    DOOR,
    DOWN,
    DROP,
    EMPTY,
    FORWARD,
    GOAL,
    KEY,
    LEFT,
    LOCKED,
    OPEN,
    PICKUP,
    RIGHT,
    TOGGLE,
    TURN_LEFT,
    TURN_RIGHT,
    UP,
    WALL,
)

__all__ = ["State", "distances", "distances_to_goal", "optimal_actions", "parse", "reachable", "shortest_path"]

Cells = NDArray[np.uint8]
Integers = NDArray[np.int64]

NOWHERE: Final = -1
_ANY_GOAL: Final = -1  # instead of a target: every state with the agent on the goal
_UNLIMITED: Final = 2**40
_FAULTS: Final = (
    "",
    "its outer border is not all walls",
    "it holds an object that is neither empty, wall, door, key, goal nor agent",
    "the agent's direction is not in 0..3",
    "the door's state is not in 0..2",
    "it does not hold exactly one agent",
    "it holds more than one key, door or goal",
)
"""What can be wrong with a map, by the number that ``_fault`` returns; 0 stands for nothing."""


class State(NamedTuple):
    """The full state of N grids. Cells are y * S + x."""

    agent: Integers  # [N] cell
    direction: Integers  # [N] 0 right, 1 down, 2 left, 3 up
    key: Integers  # [N] cell; S * S if in hand, or if there is none
    door_state: Integers  # [N] 0 open, 1 closed, 2 locked; 0 if there is none
    door: Integers  # [N] cell, or -1 if there is none
    goal: Integers  # [N] cell


def parse(observations: Cells) -> State:
    """Read the full state from observations uint8 [N, S, S, 3]."""
    observations = _batch(observations)
    out = np.empty((6, len(observations)), np.int64)
    _parse_all(observations, out)
    return State(*out)


def distances_to_goal(observations: Cells) -> Integers:
    """Return the number of steps to the goal on a shortest path, int64 [N], from observations uint8 [N, S, S, 3]."""
    observations = _batch(observations)
    out = np.empty(len(observations), np.int64)
    actions = np.empty(len(observations), np.int64)
    _solve_all(observations, out, actions)
    return out


def optimal_actions(observations: Cells) -> Integers:
    """Return the first action of a shortest path to the goal, int64 [N]; "done" where there is no path to go."""
    observations = _batch(observations)
    out = np.empty(len(observations), np.int64)
    actions = np.empty(len(observations), np.int64)
    _solve_all(observations, out, actions)
    return actions


def shortest_path(observation: Cells) -> Integers:
    """Return the actions of a shortest path to the goal, int64 [L], from one observation uint8 [S, S, 3].

    Raises:
        ValueError: The goal cannot be reached.
    """
    return _path(_batch(observation[None]))


def distances(sources: Cells, targets: Cells, limit: int | None = None) -> Integers:
    """Return the least number of steps from each source's state to its target's, int64 [N].

    Args:
        sources: Observations uint8 [N, S, S, 3].
        targets: Observations uint8 [N, S, S, 3]. One of another map is out of reach.
        limit: Look no further than this number of steps; None for no limit. A small limit saves much time.
    """
    sources, targets = _batch(sources, "sources"), _batch(targets, "targets")
    if sources.shape != targets.shape:
        raise ValueError(f"sources and targets must have one shape, got {sources.shape} and {targets.shape}.")
    out = np.empty(len(sources), np.int64)
    _distances_all(sources, targets, _UNLIMITED if limit is None else check_integer("limit", limit, 0), out)
    return out


def reachable(sources: Cells, targets: Cells, k: int) -> NDArray[np.bool_]:
    """Return whether some sequence of at most ``k`` actions leads from each source's state to its target's, bool [N].

    This is the ground-truth reachability network (appendix B.2): every state reaches itself, the relation is
    directed, and a state on the goal, where the episode is over, reaches nothing else.
    """
    return np.not_equal(distances(sources, targets, limit=check_integer("k", k, 0)), NOWHERE)


def _batch(observations: Cells, name: str = "observations") -> Cells:
    """Return observations in the one layout that the kernels are compiled for, each a map that they may walk on.

    Compiled code checks no index: on a map without a border, or without an agent, it would leave its arrays.
    """
    observations = np.asarray(observations)
    shape = observations.shape
    if observations.dtype != np.uint8 or len(shape) != 4 or shape[1] != shape[2] or shape[3] != 3:
        raise ValueError(f"{name} must be uint8 [N, S, S, 3], got {observations.dtype} {list(shape)}.")
    observations = np.require(observations, requirements=["C", "W"])
    row, fault = _first_fault(observations)
    if fault:
        raise ValueError(f"{name}[{row}] is no map of a grid task: {_FAULTS[fault]}.")
    return observations


def _path(observations: Cells) -> Integers:
    out = np.empty(_num_codes(observations.shape[1]), np.int64)
    length = _path_of(observations[0], out)
    if length == NOWHERE:
        raise ValueError("There is no path from this state to the goal.")
    return out[:length].copy()


# A map is (S, cells, door, goal): walls are read from the cells of any of its observations. A state is one integer,
# ((key * 3 + door state) * S * S + agent) * 4 + direction.


@inline
def _num_codes(size: int) -> int:
    area = size * size
    return (area + 1) * 3 * area * 4


@inline
def _code(area: int, agent: int, direction: int, key: int, door_state: int) -> int:
    return ((key * 3 + door_state) * area + agent) * 4 + direction


@kernel
def _first_fault(observations: Cells) -> tuple[int, int]:
    """Return the first row that is no valid map and the number of its fault; the fault is 0 if there is none."""
    for row in range(observations.shape[0]):
        fault = _fault(observations[row])
        if fault:
            return row, fault
    return 0, 0


@inline
def _fault(cells: Cells) -> int:
    """Return what is wrong with a map, as a place in ``_FAULTS``.

    No goal and no door are legal: the agent hides what it stands on.
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


@inline
def _parse(cells: Cells, out: Integers) -> None:
    """Fill ``out`` with the fields of ``State``."""
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
    """Return whether the inner walls stand in one column, as in KeyDoors, and not in several, as in FourRooms."""
    size = cells.shape[0]
    columns = 0
    for x in range(1, size - 1):
        walls = 0
        for y in range(1, size - 1):
            walls += cells[y, x, 0] == WALL
        columns += walls > 0
    return columns == 1


@inline
def _ahead(size: int, agent: int, direction: int) -> int:
    """Return the cell in front of the agent."""
    return agent + (direction == RIGHT) - (direction == LEFT) + size * ((direction == DOWN) - (direction == UP))


@inline
def _next(code: int, action: int, cells: Cells, door: int, goal: int) -> int:
    """Return the state after one action."""
    size = cells.shape[0]
    area = size * size
    direction, agent, objects = code % 4, code // 4 % area, code // (4 * area)
    door_state, key = objects % 3, objects // 3
    ahead = _ahead(size, agent, direction)
    is_wall = cells[ahead // size, ahead % size, 0] == WALL
    if action == TURN_LEFT:
        direction = (direction + 3) % 4
    elif action == TURN_RIGHT:
        direction = (direction + 1) % 4
    elif action == FORWARD:
        if not is_wall and ahead != key and (ahead != door or door_state == OPEN):
            agent = ahead
    elif action == PICKUP:
        if ahead == key:
            key = area
    elif action == DROP:
        if door != NOWHERE and key == area and not is_wall and ahead not in (door, goal):
            key = ahead
    elif action == TOGGLE and ahead == door and (door_state != LOCKED or key == area):
        door_state = CLOSED if door_state == OPEN else OPEN
    return _code(area, agent, direction, key, door_state)


@inline
def _least(code: int, target: int, size: int) -> int:
    """Return a number of steps that cannot be undercut: what still differs, each action mending one thing by one."""
    area = size * size
    agent, target_agent = code // 4 % area, target // 4 % area
    rows, columns = agent // size - target_agent // size, agent % size - target_agent % size
    quarters = (code - target) % 4
    door_state, target_door_state = code // (4 * area) % 3, target // (4 * area) % 3
    key, target_key = code // (12 * area), target // (12 * area)
    if target_door_state == LOCKED and door_state != LOCKED:
        return _UNLIMITED
    handled = 0 if key == target_key else 1 if area in (key, target_key) else 2
    return abs(rows) + abs(columns) + min(quarters, 4 - quarters) + handled + (door_state != target_door_state)


@inline
def _search(
    start: int,
    target: int,
    cells: Cells,
    door: int,
    goal: int,
    limit: int,
    stamp: int,
    stamps: Integers,
    queue: Integers,
    parents: Integers,
) -> tuple[int, int]:
    """Search breadth-first; return the number of steps and the state found.

    On the way to the goal the key is never dropped: who keeps it can walk every path, and toggle every door, that
    who drops it can. ``stamps`` marks the states seen in this search by ``stamp``, so that it need not be cleared;
    ``parents`` holds 8 * (state before) + action.
    """
    size = cells.shape[0]
    area = size * size
    if target != _ANY_GOAL and _least(start, target, size) > limit:
        return NOWHERE, start
    stamps[start] = stamp
    queue[0] = start
    head, tail, depth = 0, 1, 0
    while head < tail:
        level_end = tail
        while head < level_end:
            code = queue[head]
            head += 1
            agent = code // 4 % area
            if code == target or (target == _ANY_GOAL and agent == goal):
                return depth, code
            if depth >= limit or agent == goal:
                continue
            for action in range(DONE):
                if target == _ANY_GOAL and action == DROP:
                    continue
                after = _next(code, action, cells, door, goal)
                if stamps[after] == stamp:
                    continue
                stamps[after] = stamp
                if target != _ANY_GOAL and depth + 1 + _least(after, target, size) > limit:
                    continue
                parents[after] = 8 * code + action
                queue[tail] = after
                tail += 1
        depth += 1
    return NOWHERE, start


@kernel
def _parse_all(observations: Cells, out: Integers) -> None:
    """Fill ``out`` [6, N]."""
    for index in range(observations.shape[0]):
        _parse(observations[index], out[:, index])


@kernel
def _distances_all(sources: Cells, targets: Cells, limit: int, out: Integers) -> None:
    """Fill ``out`` [N] with the distances between two batches of observations."""
    size = sources.shape[1]
    area = size * size
    stamps = np.zeros(_num_codes(size), np.int64)
    queue, parents = np.empty_like(stamps), np.empty_like(stamps)
    here, there = np.empty(6, np.int64), np.empty(6, np.int64)
    for index in range(sources.shape[0]):
        cells = sources[index]
        _parse(cells, here)
        _parse(targets[index], there)
        out[index] = NOWHERE
        if here[4] == there[4] and here[5] == there[5] and _same_walls(cells, targets[index]):
            start = _code(area, here[0], here[1], here[2], here[3])
            target = _code(area, there[0], there[1], there[2], there[3])
            out[index], _ = _search(start, target, cells, here[4], here[5], limit, index + 1, stamps, queue, parents)


@inline
def _same_walls(cells: Cells, others: Cells) -> bool:
    for y in range(cells.shape[0]):
        for x in range(cells.shape[1]):
            if (cells[y, x, 0] == WALL) != (others[y, x, 0] == WALL):
                return False
    return True


@kernel
def _solve_all(observations: Cells, out: Integers, actions: Integers) -> None:
    """Fill ``out`` [N] with the distances to the goal, and ``actions`` [N] with the first actions."""
    size = observations.shape[1]
    stamps = np.zeros(_num_codes(size), np.int64)
    queue, parents = np.empty_like(stamps), np.empty_like(stamps)
    state = np.empty(6, np.int64)
    for index in range(observations.shape[0]):
        cells = observations[index]
        _parse(cells, state)
        start = _code(size * size, state[0], state[1], state[2], state[3])
        out[index], code = _search(
            start, _ANY_GOAL, cells, state[4], state[5], _UNLIMITED, index + 1, stamps, queue, parents
        )  # fmt: skip
        actions[index] = DONE
        while code != start:
            actions[index] = parents[code] % 8
            code = parents[code] // 8


@kernel
def _path_of(cells: Cells, out: Integers) -> int:
    """Fill ``out`` with the actions of a shortest path to the goal, and return their number."""
    size = cells.shape[0]
    stamps = np.zeros(_num_codes(size), np.int64)
    queue, parents = np.empty_like(stamps), np.empty_like(stamps)
    state = np.empty(6, np.int64)
    _parse(cells, state)
    start = _code(size * size, state[0], state[1], state[2], state[3])
    length, code = _search(start, _ANY_GOAL, cells, state[4], state[5], _UNLIMITED, 1, stamps, queue, parents)
    for place in range(length - 1, -1, -1):
        out[place] = parents[code] % 8
        code = parents[code] // 8
    return length
