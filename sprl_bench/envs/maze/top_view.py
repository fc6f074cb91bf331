"""Pictures for people: what the agent sees, with the maze from above beside it."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from sprl_bench.envs.maze.directions import DIRECTIONS
from sprl_bench.envs.maze.levels import CORRIDOR, WALL
from sprl_bench.envs.maze.motion import CELL, Integers
from sprl_bench.envs.maze.textures import SPRITE_TEXELS, SPRITES

Picture = NDArray[np.uint8]

ZOOM: Final = 4
_SIDE: Final = 84 * ZOOM
_WALL_COLOUR: Final = (70, 70, 80)
_CORRIDOR_COLOUR: Final = (225, 225, 225)
_ROOM_COLOUR: Final = (205, 215, 235)
_AGENT_COLOUR: Final = (30, 90, 220)
_THING_SIDE: Final = 0.8  # of a cell
_AGENT_LENGTH: Final = 0.7
_AGENT_HALF_ANGLE: Final = 0.45  # radians


def beside(frame: Picture, cells: Picture, pose: Integers, things: Integers) -> Picture:
    """Return the first-person picture and the view from above, uint8 [336, 672, 3].

    Args:
        frame: What the agent sees, uint8 [84, 84, 3].
        cells: The layout, uint8 [S, S].
        pose: Of the agent, int64 [5].
        things: int64 [T, 3]: x, y, kind.
    """
    return np.hstack([frame.repeat(ZOOM, axis=0).repeat(ZOOM, axis=1), _from_above(cells, pose, things)])


def _from_above(cells: Picture, pose: Integers, things: Integers) -> Picture:
    places = (np.arange(_SIDE) + 0.5) * len(cells) / _SIDE  # of pixels, in cells
    y, x = np.meshgrid(places, places, indexing="ij")
    colours = np.full((*cells.shape, 3), _ROOM_COLOUR, np.uint8)
    colours[cells == CORRIDOR] = _CORRIDOR_COLOUR
    colours[cells == WALL] = _WALL_COLOUR
    picture: Picture = colours[y.astype(int), x.astype(int)]
    for thing in things:
        _put_thing(picture, x - thing[0], y - thing[1], int(thing[2]))
    _put_agent(picture, x - pose[0] / CELL, y - pose[1] / CELL, pose[2] * 2 * np.pi / DIRECTIONS)
    return picture


def _put_thing(picture: Picture, x: NDArray[Any], y: NDArray[Any], kind: int) -> None:
    """Put a thing into the middle of the cell whose corner is the origin of x and y."""
    column, row = ((((place - 0.5) / _THING_SIDE + 0.5) * SPRITE_TEXELS).astype(int) for place in (x, y))
    inside = (column >= 0) & (column < SPRITE_TEXELS) & (row >= 0) & (row < SPRITE_TEXELS)
    inside[inside] = SPRITES[kind, row[inside], column[inside], 3] == 1
    picture[inside] = SPRITES[kind, row[inside], column[inside], :3]


def _put_agent(picture: Picture, x: NDArray[Any], y: NDArray[Any], angle: float) -> None:
    """Put an arrow, whose middle is the origin of x and y."""
    ahead = x * np.cos(angle) + y * np.sin(angle)
    aside = y * np.cos(angle) - x * np.sin(angle)
    tip = _AGENT_LENGTH / 2 - ahead
    picture[(abs(aside) <= tip * np.tan(_AGENT_HALF_ANGLE)) & (tip <= _AGENT_LENGTH)] = _AGENT_COLOUR
