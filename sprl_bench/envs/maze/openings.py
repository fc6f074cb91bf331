"""How an episode begins: from a vector of uniform draws to a maze, its things, a start and a look.

Each episode draws one vector of doubles, and each new start within an episode another. A choice among n is
floor(u * n).
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from sprl_bench.envs.compiled import inline, kernel
from sprl_bench.envs.maze.cell_paths import UNREACHED, measure
from sprl_bench.envs.maze.directions import DIRECTIONS
from sprl_bench.envs.maze.levels import BAD, GOAL, GOOD, GOOD_OBJECTS, PLACE, SPAWN
from sprl_bench.envs.maze.motion import CELL, CELL_BITS
from sprl_bench.envs.maze.raycast import (
    CEILING_SURFACE,
    FLOOR_SURFACE,
    KEY_BITS,
    LOOK_KEY,
    LOOK_VALUES,
    NUM_SURFACES,
    SURFACE_VALUES,
)
from sprl_bench.envs.maze.textures import NUM_PATTERNS
from sprl_bench.envs.maze.worlds import Cells, Rules, Streams, Worlds
from sprl_bench.envs.streams import next_double

Uniforms = NDArray[np.float64]

# The draws of an episode. A new start within an episode takes the first START_DRAWS, or START_DRAWS and PLACE_DRAWS.
_SPAWN_DRAW: Final = 0
_ANGLE_DRAW: Final = 1
START_DRAWS: Final = 2
PLACE_DRAWS: Final = 8
_LAYOUT_DRAW: Final = START_DRAWS + PLACE_DRAWS
_LOOK_DRAWS: Final = _LAYOUT_DRAW + 1
DRAWS: Final = _LOOK_DRAWS + LOOK_VALUES

_DARKEST: Final = 64  # of a colour's channel


@inline
def _fill(uniforms: Uniforms, count: int, stream: Streams) -> None:
    for index in range(count):
        uniforms[index] = next_double(stream)


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
def take_layout(worlds: Worlds, row: int, bank: Cells, index: int) -> None:
    """Give a row one of the layouts, without any distances yet."""
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
def begin(worlds: Worlds, row: int, bank: Cells, rules: Rules, uniforms: Uniforms) -> None:
    """Start an episode; `uniforms` [DRAWS] is scratch space."""
    _fill(uniforms, DRAWS, worlds.streams[row])
    index, least = _pick(uniforms[_LAYOUT_DRAW], bank.shape[0]), rules.minimum_goal_distance
    take_layout(worlds, row, bank, index)
    if worlds.things.shape[1] > 1:
        _put_objects(worlds, row, uniforms)
    else:
        while not _put_goal(worlds, row, least, uniforms[START_DRAWS]):
            index = (index + 1) % bank.shape[0]
            take_layout(worlds, row, bank, index)
    _put_agent(worlds, row, least, uniforms)
    _dress(worlds, row, uniforms)
    worlds.is_success[row] = False


@inline
def begin_again(worlds: Worlds, row: int, least: int, uniforms: Uniforms) -> None:
    """Go on after a success: draw a start, and the objects if there are any. Maze, look and goal stay."""
    if worlds.things.shape[1] > 1:
        _fill(uniforms, START_DRAWS + PLACE_DRAWS, worlds.streams[row])
        _put_objects(worlds, row, uniforms)
    else:
        _fill(uniforms, START_DRAWS, worlds.streams[row])
    _put_agent(worlds, row, least, uniforms)
