"""Small deterministic worlds: a table of successors, made from maps of the grid tasks, and their distances."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sprl_bench import solver
from sprl_bench.envs.checks import check_array, check_integer
from sprl_bench.envs.grid.encoding import CLOSED, LOCKED, OPEN, WALL

Cell = tuple[int, int]
Integers = NDArray[np.int64]
Flags = NDArray[np.bool_]

NOWHERE: Final = -1
STEPS: Final = ((1, 0), (0, 1), (-1, 0), (0, -1))  # (x, y) in the order of the directions: right, down, left, up


@dataclass(frozen=True, eq=False)
class World:
    """A deterministic world with one start.

    Raises:
        TypeError: The start is not an integer.
        ValueError: The table has a state that does not exist, or a shape is wrong.
    """

    successors: Integers  # [S, A] the state after each action
    goal: Flags  # [S] whether reaching the state is rewarded and ends the episode
    start: int

    def __post_init__(self) -> None:
        states = len(self.successors)
        if self.successors.ndim != 2 or self.successors.dtype != np.int64 or not self.successors.size:
            raise ValueError(
                f"successors is {self.successors.dtype} {list(self.successors.shape)}; it must be int64 [S, A]."
            )
        low, high = int(self.successors.min()), int(self.successors.max())
        if low < 0 or high >= states:
            raise ValueError(f"successors is from {low} to {high}; it must be states from 0 to {states - 1}.")
        check_array("goal", self.goal, (states,), np.dtype(np.bool_))
        check_integer("start", self.start, 0, states - 1)


def cardinal_world(observation: NDArray[np.uint8]) -> World:
    """Return the world of moves right, down, left and up on the free cells of a map; walls block moves.

    Args:
        observation: Observation of a FourRooms task, uint8 [S, S, 3]. The start is the agent's cell.

    Raises:
        ValueError: It is not a map, or it has a key or a door.
    """
    cells, agent, _, goal = _read(observation)
    successors = [[_neighbour(cells, cell, *step) for step in STEPS] for cell in cells]
    return World(np.asarray(successors), np.asarray([cell == goal for cell in cells]), cells[agent])


def pose_world(observation: NDArray[np.uint8]) -> World:
    """Return the world of the actions left, right and forward; a state is a free cell and a direction.

    The goal is reached in any direction. The other four actions of FourRooms have no effect and are left out.

    Args:
        observation: Observation of a FourRooms task, uint8 [S, S, 3]. The start is the agent's pose.

    Raises:
        ValueError: It is not a map, or it has a key or a door.
    """
    cells, agent, direction, goal = _read(observation)
    successors = [
        [4 * number + (heading - 1) % 4, 4 * number + (heading + 1) % 4, 4 * _neighbour(cells, cell, *step) + heading]
        for cell, number in cells.items()
        for heading, step in enumerate(STEPS)
    ]
    return World(
        np.asarray(successors), np.asarray([cell == goal for cell in cells]).repeat(4), 4 * cells[agent] + direction
    )


class KeyState(NamedTuple):
    """A state of KeyDoors: the agent's cell (x, y) and direction, whether it has the key, and the door's state."""

    cell: Cell
    heading: int
    has_key: bool
    door: int


def key_world(observation: NDArray[np.uint8]) -> World:
    """Return the world of left, right, forward, pickup and toggle on a map of KeyDoors, from the agent's pose.

    States are those that can be reached. Dropping the key is left out: it only undoes picking it up.

    Args:
        observation: Observation of a KeyDoors task, uint8 [S, S, 3], with its key and its door.

    Raises:
        ValueError: It is not such a map.
    """
    state = solver.parse(observation[None])
    size = observation.shape[0]
    if state.door[0] == NOWHERE or state.key[0] == size * size:
        raise ValueError("observation has no door, or no key on the floor; it must be a map of KeyDoors.")
    agent, key, door, goal = (
        (int(cell) % size, int(cell) // size) for cell in (state.agent[0], state.key[0], state.door[0], state.goal[0])
    )
    walls = {(x, y) for y in range(size) for x in range(size) if observation[y, x, 0] == WALL}
    start = KeyState(agent, int(state.direction[0]), has_key=False, door=int(state.door_state[0]))
    numbers, table = _explored(start, lambda now: _moves(now, walls, key, door))
    return World(np.asarray(table), np.asarray([now.cell == goal for now in numbers]), 0)


def _moves(now: KeyState, walls: set[Cell], key: Cell, door: Cell) -> list[KeyState]:
    """Return the states after left, right, forward, pickup and toggle."""
    front = now.cell[0] + STEPS[now.heading][0], now.cell[1] + STEPS[now.heading][1]
    blocked = front in walls or (front == key and not now.has_key) or (front == door and now.door != OPEN)
    toggles = front == door and (now.door != LOCKED or now.has_key)
    return [
        now._replace(heading=(now.heading - 1) % 4),
        now._replace(heading=(now.heading + 1) % 4),
        now if blocked else now._replace(cell=front),
        now._replace(has_key=True) if front == key else now,
        now._replace(door=CLOSED if now.door == OPEN else OPEN) if toggles else now,
    ]


def _explored(
    start: KeyState, moves: Callable[[KeyState], list[KeyState]]
) -> tuple[dict[KeyState, int], list[list[int]]]:
    """Return the number of each state that can be reached, and the numbers of its successors."""
    numbers, table = {start: 0}, []
    queue = deque([start])
    while queue:
        after = moves(queue.popleft())
        queue.extend(dict.fromkeys(state for state in after if state not in numbers))
        for state in after:
            numbers.setdefault(state, len(numbers))
        table.append([numbers[state] for state in after])
    return numbers, table


def _read(observation: NDArray[np.uint8]) -> tuple[dict[Cell, int], Cell, int, Cell]:
    """Return the free cells (x, y) with their numbers, the agent's cell and direction, and the goal's cell."""
    state = solver.parse(observation[None])
    size = observation.shape[0]
    if state.door[0] != NOWHERE or state.key[0] != size * size:
        raise ValueError("observation has a key or a door; it must be a map of FourRooms.")
    free = [(x, y) for y in range(size) for x in range(size) if observation[y, x, 0] != WALL]
    agent, goal = int(state.agent[0]), int(state.goal[0])
    return (
        {cell: number for number, cell in enumerate(free)},
        (agent % size, agent // size),
        int(state.direction[0]),
        (goal % size, goal // size),
    )


def _neighbour(cells: dict[Cell, int], cell: Cell, right: int, down: int) -> int:
    """Return the number of the neighbouring cell, or of this cell if there is a wall."""
    return cells.get((cell[0] + right, cell[1] + down), cells[cell])


def distances(world: World) -> Integers:
    """Return D between all states, [S, S]; -1 if unreachable. No state is reachable from the goal but itself."""
    states = len(world.successors)
    leads_to = np.zeros((states, states), np.float32)  # products of floats are much faster than those of booleans
    leads_to[np.arange(states)[:, None], world.successors] = 1
    leads_to[world.goal] = 0
    out = np.full((states, states), NOWHERE)
    newest = np.eye(states, dtype=np.bool_)
    step = 0
    while newest.any():
        out[newest] = step
        newest = (newest.astype(np.float32) @ leads_to > 0) & (out == NOWHERE)
        step += 1
    return out


def num_reachable(world: World) -> int:
    """Return the number of states that are reachable from the start, including itself."""
    return int(np.count_nonzero(distances(world)[world.start] != NOWHERE))


def shortest_path(world: World) -> list[int]:
    """Return the states of a shortest path from the start to the nearest goal, [L + 1].

    Raises:
        ValueError: No goal can be reached.
    """
    table = distances(world)
    goals = [state for state in np.flatnonzero(world.goal) if table[world.start, state] != NOWHERE]
    if not goals:
        raise ValueError("world has no reachable goal; it must have one.")
    target = min(goals, key=lambda state: int(table[world.start, state]))
    path = [world.start]
    while path[-1] != target:
        left = table[path[-1], target]
        path.append(next(int(state) for state in world.successors[path[-1]] if table[state, target] == left - 1))
    return path
