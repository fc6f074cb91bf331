"""N mazes in arrays, and the compiled functions that start and step them. The single environment is the case N = 1.

Each episode draws one vector of doubles, and each new start within an episode another; these functions decode them, by
floor(u * n) for a choice among n.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sprl_bench.envs.compiled import inline, kernel
from sprl_bench.envs.maze.cell_paths import UNREACHED, measure
from sprl_bench.envs.maze.directions import DIRECTIONS
from sprl_bench.envs.maze.levels import (
    BAD,
    FRAMES,
    GOAL,
    GOOD,
    GOOD_OBJECTS,
    NOTHING,
    PLACE,
    REWARDS,
    SPAWN,
)
from sprl_bench.envs.maze.motion import CELL, CELL_BITS, REACH, Cells, Integers, is_inside_wall, move
from sprl_bench.envs.maze.raycast import (
    CEILING_SURFACE,
    FLOOR_SURFACE,
    KEY_BITS,
    LOOK_KEY,
    LOOK_VALUES,
    NUM_SURFACES,
    SURFACE_VALUES,
    Columns,
    draw,
    new_columns,
)
from sprl_bench.envs.maze.textures import NUM_PATTERNS
from sprl_bench.envs.streams import STREAM_LIMBS, next_double

Flags = NDArray[np.bool_]
Uniforms = NDArray[np.float64]
Streams = NDArray[np.uint64]

# The draws of an episode. A new start within an episode takes the first START_DRAWS, or START_DRAWS and PLACE_DRAWS.
_SPAWN_DRAW: Final = 0
_ANGLE_DRAW: Final = 1
START_DRAWS: Final = 2
PLACE_DRAWS: Final = 8
_LAYOUT_DRAW: Final = START_DRAWS + PLACE_DRAWS
_LOOK_DRAWS: Final = _LAYOUT_DRAW + 1
DRAWS: Final = _LOOK_DRAWS + LOOK_VALUES

_DARKEST: Final = 64  # of a colour's channel


class Worlds(NamedTuple):
    """The state of N mazes, and what follows from it."""

    layouts: Integers  # [N] index in the bank
    poses: Integers  # [N, 5] x, y, angle, speed x, speed y (see `motion`)
    things: Integers  # [N, T, 3] x, y, kind
    looks: Integers  # [N, LOOK_VALUES] (see `raycast`)
    is_success: Flags  # [N] whether the episode has paid a positive reward
    streams: Streams  # [N, STREAM_LIMBS]
    cells: Cells  # [N, S, S], of the layout
    distances: Integers  # [N, S, S] from each cell to the nearest goal or good object, in cells

    def state(self) -> dict[str, NDArray[np.generic]]:
        """Return the arrays that the others follow from, by name."""
        return {name: getattr(self, name) for name in self._fields[:6]}


class Rules(NamedTuple):
    """What the compiled functions need to know about the level and the arguments of the environment."""

    horizon: int
    minimum_goal_distance: int
    fog: bool


def new_worlds(num_envs: int, size: int, num_things: int) -> Worlds:
    """Allocate N mazes of S x S cells with T things."""
    return Worlds(
        layouts=np.zeros(num_envs, np.int64),
        poses=np.zeros((num_envs, 5), np.int64),
        things=np.zeros((num_envs, num_things, 3), np.int64),
        looks=np.zeros((num_envs, LOOK_VALUES), np.int64),
        is_success=np.zeros(num_envs, np.bool_),
        streams=np.zeros((num_envs, STREAM_LIMBS), np.uint64),
        cells=np.zeros((num_envs, size, size), np.uint8),
        distances=np.zeros((num_envs, size, size), np.int64),
    )


@inline
def _pick(uniform: float, count: int) -> int:
    return int(uniform * count)


@kernel
def _find(worlds: Worlds, row: int, kind: int, least: int, index: int) -> tuple[int, int]:
    """Return (x, y) of the cell with this index among those of a kind at least `least` cells from what is sought.

    With an index beyond their number, return (that number, -1).
    """
    size, found = worlds.cells.shape[1], 0
    for y in range(size):
        for x in range(size):
            if worlds.cells[row, y, x] == kind and worlds.distances[row, y, x] >= least:
                if found == index:
                    return x, y
                found += 1
    return found, -1


@inline
def _count(worlds: Worlds, row: int, kind: int, least: int) -> int:
    return _find(worlds, row, kind, least, 1 << 30)[0]


@inline
def _put_agent(worlds: Worlds, row: int, least: int, uniforms: Uniforms) -> None:
    """Put the agent, at rest, into the middle of a start at least `least` cells from the goal."""
    x, y = _find(worlds, row, SPAWN, least, _pick(uniforms[_SPAWN_DRAW], _count(worlds, row, SPAWN, least)))
    worlds.poses[row, 0], worlds.poses[row, 1] = (x << CELL_BITS) + CELL // 2, (y << CELL_BITS) + CELL // 2
    worlds.poses[row, 2] = _pick(uniforms[_ANGLE_DRAW], DIRECTIONS)
    worlds.poses[row, 3], worlds.poses[row, 4] = 0, 0


@inline
def _set_thing(worlds: Worlds, row: int, thing: int, x: int, y: int, kind: int) -> None:
    worlds.things[row, thing, 0], worlds.things[row, thing, 1], worlds.things[row, thing, 2] = x, y, kind


@inline
def _put_goal(worlds: Worlds, row: int, least: int, uniform: float) -> bool:
    """Put the goal on the place drawn, or the next with a start at least `least` cells away; return whether any has."""
    count = _count(worlds, row, PLACE, UNREACHED)
    first = _pick(uniform, count)
    for offset in range(count):
        x, y = _find(worlds, row, PLACE, UNREACHED, (first + offset) % count)
        _set_thing(worlds, row, 0, x, y, GOAL)
        measure(worlds.cells, worlds.things, row, worlds.distances)
        if _count(worlds, row, SPAWN, least) > 0:
            return True
    return False


@inline
def _put_objects(worlds: Worlds, row: int, uniforms: Uniforms) -> None:
    """Put the objects on distinct places: the first draws of a shuffle, good ones first."""
    count = _count(worlds, row, PLACE, UNREACHED)
    places = np.arange(count)
    for thing in range(worlds.things.shape[1]):
        chosen = thing + _pick(uniforms[START_DRAWS + thing], count - thing)
        places[thing], places[chosen] = places[chosen], places[thing]
        x, y = _find(worlds, row, PLACE, UNREACHED, places[thing])
        _set_thing(worlds, row, thing, x, y, GOOD if thing < GOOD_OBJECTS else BAD)
    measure(worlds.cells, worlds.things, row, worlds.distances)


@inline
def _take_layout(worlds: Worlds, row: int, bank: Cells, index: int) -> None:
    worlds.layouts[row] = index
    for y in range(bank.shape[1]):
        for x in range(bank.shape[2]):
            worlds.cells[row, y, x] = bank[index, y, x]
            worlds.distances[row, y, x] = UNREACHED


@inline
def _dress(worlds: Worlds, row: int, uniforms: Uniforms) -> None:
    """Draw the look of an episode: patterns, colours and paintings."""
    for surface in range(NUM_SURFACES):
        at = surface * SURFACE_VALUES
        pattern = _pick(uniforms[_LOOK_DRAWS + at], NUM_PATTERNS)
        worlds.looks[row, at] = pattern + NUM_PATTERNS * (surface in (FLOOR_SURFACE, CEILING_SURFACE))
        for channel in range(1, SURFACE_VALUES):
            colour = _DARKEST + _pick(uniforms[_LOOK_DRAWS + at + channel], 256 - _DARKEST)
            worlds.looks[row, at + channel] = colour
    worlds.looks[row, LOOK_KEY] = _pick(uniforms[_LOOK_DRAWS + LOOK_KEY], 1 << KEY_BITS)


@inline
def _begin(worlds: Worlds, row: int, bank: Cells, rules: Rules, uniforms: Uniforms) -> None:
    """Start an episode from `DRAWS` draws."""
    index, least = _pick(uniforms[_LAYOUT_DRAW], bank.shape[0]), rules.minimum_goal_distance
    _take_layout(worlds, row, bank, index)
    if worlds.things.shape[1] > 1:
        _put_objects(worlds, row, uniforms)
    else:
        while not _put_goal(worlds, row, least, uniforms[START_DRAWS]):
            index = (index + 1) % bank.shape[0]
            _take_layout(worlds, row, bank, index)
    _put_agent(worlds, row, least, uniforms)
    _dress(worlds, row, uniforms)
    worlds.is_success[row] = False


@inline
def _fill(uniforms: Uniforms, count: int, stream: Streams) -> None:
    for index in range(count):
        uniforms[index] = next_double(stream)


@inline
def _begin_again(worlds: Worlds, row: int, least: int, uniforms: Uniforms) -> None:
    """Go on after a success: draw a start, and the objects if there are any. Maze, look and goal stay."""
    if worlds.things.shape[1] > 1:
        _fill(uniforms, START_DRAWS + PLACE_DRAWS, worlds.streams[row])
        _put_objects(worlds, row, uniforms)
    else:
        _fill(uniforms, START_DRAWS, worlds.streams[row])
    _put_agent(worlds, row, least, uniforms)


@inline
def _taken(worlds: Worlds, row: int) -> int:
    """Return the kind of the thing that the agent touches, and take it away if it is an object."""
    for thing in range(worlds.things.shape[1]):
        kind = worlds.things[row, thing, 2]
        x = (worlds.things[row, thing, 0] << CELL_BITS) + CELL // 2 - worlds.poses[row, 0]
        y = (worlds.things[row, thing, 1] << CELL_BITS) + CELL // 2 - worlds.poses[row, 1]
        if kind != NOTHING and x * x + y * y <= REACH * REACH:
            if kind != GOAL:
                worlds.things[row, thing, 2] = NOTHING
                measure(worlds.cells, worlds.things, row, worlds.distances)
            return kind
    return NOTHING


@inline
def _is_done(worlds: Worlds, row: int) -> bool:
    """Return whether all good objects are taken."""
    for thing in range(worlds.things.shape[1]):
        if worlds.things[row, thing, 2] == GOOD:
            return False
    return True


@inline
def _act(worlds: Worlds, row: int, action: int, least: int, uniforms: Uniforms) -> float:
    """Take one action and return its reward. A new start ends the action."""
    reward = 0.0
    for _ in range(FRAMES):
        move(worlds.cells, worlds.poses, row, action)
        kind = _taken(worlds, row)
        reward += REWARDS[kind]
        if kind in (GOAL, GOOD):
            worlds.is_success[row] = True
            if kind == GOAL or _is_done(worlds, row):
                _begin_again(worlds, row, least, uniforms)
                break
    return reward


@inline
def _draw(frames: Cells, columns: Columns, worlds: Worlds, row: int, rules: Rules) -> None:
    draw(frames, columns, worlds.cells, worlds.poses, worlds.things, worlds.looks, row, rules.fog)


@kernel
def restart(rows: Integers, worlds: Worlds, bank: Cells, rules: Rules, frames: Cells) -> None:
    """Start a new episode in each of `rows`, from its stream, and draw its picture."""
    columns, uniforms = new_columns(), np.empty(DRAWS)
    for row in rows:
        _fill(uniforms, DRAWS, worlds.streams[row])
        _begin(worlds, row, bank, rules, uniforms)
        _draw(frames, columns, worlds, row, rules)


@kernel
def advance(
    start: int,
    stop: int,
    actions: Integers,
    skipped: Flags,
    elapsed: Integers,
    worlds: Worlds,
    rules: Rules,
    frames: Cells,
    rewards: NDArray[np.float64],
    truncations: Flags,
) -> None:
    """Step the mazes from `start` to `stop`; skipped ones do not change and get reward 0.

    `elapsed` already includes this step.
    """
    columns, uniforms = new_columns(), np.empty(DRAWS)
    for row in range(start, stop):
        rewards[row], truncations[row] = 0.0, False
        if not skipped[row]:
            rewards[row] = _act(worlds, row, actions[row], rules.minimum_goal_distance, uniforms)
            truncations[row] = elapsed[row] >= rules.horizon
            _draw(frames, columns, worlds, row, rules)


@kernel
def derive(worlds: Worlds, bank: Cells, rules: Rules, frames: Cells) -> None:
    """Compute all that follows from the state: cells, distances and pictures."""
    columns = new_columns()
    for row in range(worlds.layouts.shape[0]):
        _take_layout(worlds, row, bank, worlds.layouts[row])
        measure(worlds.cells, worlds.things, row, worlds.distances)
        _draw(frames, columns, worlds, row, rules)


@kernel
def stands_in_wall(cells: Cells, poses: Integers) -> bool:
    """Return whether any agent, inside its maze, overlaps a wall."""
    for row in range(poses.shape[0]):
        if is_inside_wall(cells, row, poses[row, 0], poses[row, 1]):
            return True
    return False


@kernel
def first_invalid(actions: Integers, skipped: Flags, highest: int) -> int:
    """Return the first row that is not skipped and has an action out of range, or -1."""
    for row in range(actions.shape[0]):
        if (actions[row] < 0 or actions[row] > highest) and not skipped[row]:
            return row
    return -1


