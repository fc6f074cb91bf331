"""Breadth-first search over the full states of one map.

A map is (S, cells, door, goal); any observation of it shows its walls. A state is one integer,
((key * 3 + door state) * S * S + agent) * 4 + direction.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from sprl_bench.envs.compiled import inline, kernel
from sprl_bench.envs.grid.encoding import (
    CLOSED,
    DONE,
    DOWN,
    DROP,
    FORWARD,
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
from sprl_bench.solver.maps import NOWHERE, Cells, Integers, read_state, same_walls

UNLIMITED: Final = 2**40
_ANY_GOAL: Final = -1  # as a target: all states with the agent on the goal


@kernel
def distances_all(sources: Cells, targets: Cells, limit: int, out: Integers) -> None:
    """Fill `out` [N] with the distances between two batches of observations."""
    size = sources.shape[1]
    area = size * size
    stamps = np.zeros(num_codes(size), np.int64)
    queue, parents = np.empty_like(stamps), np.empty_like(stamps)
    here, there = np.empty(6, np.int64), np.empty(6, np.int64)
    for index in range(sources.shape[0]):
        cells = sources[index]
        read_state(cells, here)
        read_state(targets[index], there)
        out[index] = NOWHERE
        if here[4] == there[4] and here[5] == there[5] and same_walls(cells, targets[index]):
            start = _code(area, here[0], here[1], here[2], here[3])
            target = _code(area, there[0], there[1], there[2], there[3])
            out[index], _ = _search(start, target, cells, here[4], here[5], limit, index + 1, stamps, queue, parents)


@kernel
def solve_all(observations: Cells, out: Integers, actions: Integers) -> None:
    """Fill `out` [N] with the distances to the goal, and `actions` [N] with the first actions."""
    size = observations.shape[1]
    stamps = np.zeros(num_codes(size), np.int64)
    queue, parents = np.empty_like(stamps), np.empty_like(stamps)
    state = np.empty(6, np.int64)
    for index in range(observations.shape[0]):
        cells = observations[index]
        read_state(cells, state)
        start = _code(size * size, state[0], state[1], state[2], state[3])
        out[index], code = _search(
            start, _ANY_GOAL, cells, state[4], state[5], UNLIMITED, index + 1, stamps, queue, parents
        )  # fmt: skip
        actions[index] = DONE
        while code != start:
            actions[index] = parents[code] % 8
            code = parents[code] // 8


@kernel
def path_of(cells: Cells, out: Integers) -> int:
    """Fill `out` with the actions of a shortest path to the goal, and return their number."""
    size = cells.shape[0]
    stamps = np.zeros(num_codes(size), np.int64)
    queue, parents = np.empty_like(stamps), np.empty_like(stamps)
    state = np.empty(6, np.int64)
    read_state(cells, state)
    start = _code(size * size, state[0], state[1], state[2], state[3])
    length, code = _search(start, _ANY_GOAL, cells, state[4], state[5], UNLIMITED, 1, stamps, queue, parents)
    for place in range(length - 1, -1, -1):
        out[place] = parents[code] % 8
        code = parents[code] // 8
    return length


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

    A search for the goal never drops the key, because an agent with the key can do everything that one without it can.
    `stamps` marks the states seen in this search with `stamp`, so it is not cleared between searches. `parents` holds
    8 * (state before) + action.
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


@inline
def _least(code: int, target: int, size: int) -> int:
    """Return a lower bound of the distance: each action changes one difference between the states by one."""
    area = size * size
    agent, target_agent = code // 4 % area, target // 4 % area
    rows, columns = agent // size - target_agent // size, agent % size - target_agent % size
    quarters = (code - target) % 4
    door_state, target_door_state = code // (4 * area) % 3, target // (4 * area) % 3
    key, target_key = code // (12 * area), target // (12 * area)
    if target_door_state == LOCKED and door_state != LOCKED:
        return UNLIMITED
    handled = 0 if key == target_key else 1 if area in (key, target_key) else 2
    return abs(rows) + abs(columns) + min(quarters, 4 - quarters) + handled + (door_state != target_door_state)


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
def _ahead(size: int, agent: int, direction: int) -> int:
    """Return the cell in front of the agent."""
    return agent + (direction == RIGHT) - (direction == LEFT) + size * ((direction == DOWN) - (direction == UP))


@inline
def _code(area: int, agent: int, direction: int, key: int, door_state: int) -> int:
    return ((key * 3 + door_state) * area + agent) * 4 + direction


@inline
def num_codes(size: int) -> int:
    """Return the number of integers that encode states on a map of S x S cells."""
    area = size * size
    return (area + 1) * 3 * area * 4
