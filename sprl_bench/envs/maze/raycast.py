"""The first-person picture: a column raycaster in integers, so that all processors draw the same bits.

The picture is 84 x 84 with a field of view of 90 degrees. The eye is half a cell above the floor, halfway to the
ceiling, so row y of the upper half and row 83 - y of the lower half see the same distance. Depths are measured along
the agent's direction, in 1/65,536 of a cell.

A look is what was drawn for one episode: for each surface a pattern and a colour, and a key that decides which walls
carry a painting.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from sprl_bench.envs.compiled import inline, kernel
from sprl_bench.envs.maze.directions import COSINES, SCALE_BITS, SINES
from sprl_bench.envs.maze.levels import CORRIDOR, GOAL, NOTHING, WALL
from sprl_bench.envs.maze.motion import CELL, CELL_BITS, Cells, Integers
from sprl_bench.envs.maze.textures import PATTERNS, SPRITE_TEXELS, SPRITES, TEXELS

SIDE: Final = 84  # pixels
_HALF: Final = SIDE // 2

RAY_BITS: Final = 17
"""A ray's components are lengths in cells for each cell of depth, times two to this power."""
_TEXEL_BITS: Final = CELL_BITS - 5
_INSIDE: Final = CELL - 1
_SCREEN: Final = _HALF << 8  # half of the picture's width, in 1/256 pixel
_NEAR: Final = CELL // 64
_SPRITE_NEAR: Final = CELL // 10
_ORDER_BITS: Final = 4  # room for the number of a thing
_FADE_BITS: Final = 10  # with fog, light is lost over 2 ** (8 + 10) / 65,536 = 4 cells
_DIM: Final = 200  # light, of 256, on the walls that run along x

# Surfaces of a look: floor, ceiling, walls of corridors and of rooms, and then paintings.
FLOOR_SURFACE: Final = 0
CEILING_SURFACE: Final = 1
CORRIDOR_SURFACE: Final = 2
ROOM_SURFACE: Final = 3
FIRST_PAINTING: Final = 4
PAINTINGS: Final = 4
NUM_SURFACES: Final = FIRST_PAINTING + PAINTINGS
SURFACE_VALUES: Final = 4  # pattern, red, green, blue
LOOK_KEY: Final = NUM_SURFACES * SURFACE_VALUES
LOOK_VALUES: Final = LOOK_KEY + 1
KEY_BITS: Final = 24

# Half of the side of a thing, and how far its centre is below the eye.
_SPRITE_HALVES: Final = (0, 26 * CELL // 100, 18 * CELL // 100, 18 * CELL // 100)
_SPRITE_DROP: Final = 15 * CELL // 100

_ACROSS: Final = np.array([round((2 * c + 1 - SIDE) * (1 << SCALE_BITS) / SIDE) for c in range(SIDE)], np.int64)
_FLOOR_DEPTHS: Final = np.array([(_HALF << CELL_BITS) // (SIDE - 1 - 2 * y) for y in range(_HALF)], np.int64)


class Columns(NamedTuple):
    """Scratch space of one picture: what is seen in each of its columns, int64 [84] each."""

    depth: Integers
    top: Integers  # the first row of the wall
    texels: Integers  # the first texel of its column in all patterns
    colour: Integers  # of the wall, packed
    ray_x: Integers
    ray_y: Integers


class Hit(NamedTuple):
    """Where a ray meets a wall."""

    depth: int
    x: int  # cell of the wall
    y: int
    side: int  # of its four faces: 0 west, 1 east, 2 north, 3 south


@inline
def new_columns() -> Columns:
    """Allocate scratch space."""
    space = np.zeros((6, SIDE), np.int64)
    return Columns(space[0], space[1], space[2], space[3], space[4], space[5])


@inline
def ray_of(angle: int, column: int) -> tuple[int, int]:
    """Return the ray (x, y) of a column."""
    cosine, sine, across = COSINES[angle], SINES[angle], _ACROSS[column]
    shift = 2 * SCALE_BITS - RAY_BITS
    return ((cosine << SCALE_BITS) - sine * across) >> shift, ((sine << SCALE_BITS) + cosine * across) >> shift


@inline
def cast(cells: Cells, row: int, x: int, y: int, ray_x: int, ray_y: int) -> Hit:
    """Follow a ray from (x, y) from cell to cell, always through a face, to the first wall."""
    cell_x, cell_y = x >> CELL_BITS, y >> CELL_BITS
    step_x, step_y = 1 if ray_x > 0 else -1, 1 if ray_y > 0 else -1
    per_x = (1 << CELL_BITS + RAY_BITS) // max(abs(ray_x), 1)  # depth for each cell along x
    per_y = (1 << CELL_BITS + RAY_BITS) // max(abs(ray_y), 1)
    next_x = ((CELL - (x & _INSIDE) if ray_x > 0 else x & _INSIDE) * per_x) >> CELL_BITS
    next_y = ((CELL - (y & _INSIDE) if ray_y > 0 else y & _INSIDE) * per_y) >> CELL_BITS
    while True:
        if next_x < next_y:
            cell_x += step_x
            if cells[row, cell_y, cell_x] == WALL:
                return Hit(next_x, cell_x, cell_y, 0 if ray_x > 0 else 1)
            next_x += per_x
        else:
            cell_y += step_y
            if cells[row, cell_y, cell_x] == WALL:
                return Hit(next_y, cell_x, cell_y, 2 if ray_y > 0 else 3)
            next_y += per_y


@inline
def _surface(cells: Cells, row: int, hit: Hit, key: int) -> int:
    """Return the surface of a wall's face: a painting on a quarter of them, else by the kind of space before it."""
    face = int((hit.y * cells.shape[2] + hit.x) * 4 + hit.side)
    mixed = ((key ^ (face * 40503)) * 2654435761) & 0xFFFFFFFF
    open_x, open_y = hit.x - (hit.side == 0) + (hit.side == 1), hit.y - (hit.side == 2) + (hit.side == 3)
    if mixed >> 30 == 0:
        return int(FIRST_PAINTING + (mixed >> 20) % PAINTINGS)
    return CORRIDOR_SURFACE if cells[row, open_y, open_x] == CORRIDOR else ROOM_SURFACE


@inline
def _light(depth: int, fog: bool) -> int:
    """Return the light, of 256, that comes from a depth."""
    return max(256 - (depth >> _FADE_BITS), 0) if fog else 256


@inline
def _packed(looks: Integers, row: int, surface: int, light: int) -> int:
    """Return the colour of a surface in a light of 256, its channels 16 bits apart: one product scales all three."""
    at = surface * SURFACE_VALUES
    red, green, blue = looks[row, at + 1] * light >> 8, looks[row, at + 2] * light >> 8, looks[row, at + 3] * light >> 8
    return int(red | green << 16 | blue << 32)


@inline
def _see(columns: Columns, cells: Cells, poses: Integers, looks: Integers, row: int, fog: bool) -> None:
    """Cast the rays of one row's agent, and fill `columns`."""
    x, y, angle = poses[row, 0], poses[row, 1], poses[row, 2]
    for column in range(SIDE):
        ray_x, ray_y = ray_of(angle, column)
        hit = cast(cells, row, x, y, ray_x, ray_y)
        depth = max(hit.depth, _NEAR)
        along = y + (depth * ray_y >> RAY_BITS) if hit.side < 2 else x + (depth * ray_x >> RAY_BITS)
        surface = _surface(cells, row, hit, looks[row, LOOK_KEY])
        light = _light(depth, fog) * (256 if hit.side < 2 else _DIM) >> 8
        column_of_texels = looks[row, surface * SURFACE_VALUES] * TEXELS + ((along & _INSIDE) >> _TEXEL_BITS)
        columns.depth[column] = depth
        columns.top[column] = max((SIDE - (_HALF << CELL_BITS) // depth) >> 1, 0)
        columns.texels[column] = column_of_texels * TEXELS
        columns.colour[column] = _packed(looks, row, surface, light)
        columns.ray_x[column], columns.ray_y[column] = ray_x, ray_y


@inline
def _put(frames: Cells, row: int, line: int, column: int, colour: int, bright: int) -> None:
    """Paint one pixel with a packed colour and the brightness, of 256, of its texel."""
    scaled = colour * bright
    frames[row, line, column, 0] = scaled >> 8 & 255
    frames[row, line, column, 1] = scaled >> 24 & 255
    frames[row, line, column, 2] = scaled >> 40 & 255


@inline
def _paint(
    frames: Cells, columns: Columns, patterns: Cells, poses: Integers, looks: Integers, row: int, fog: bool
) -> None:
    """Paint floor, ceiling and walls, two mirrored rows at a time."""
    x, y = poses[row, 0], poses[row, 1]
    floor_texels = looks[row, FLOOR_SURFACE * SURFACE_VALUES] * TEXELS * TEXELS
    ceiling_texels = looks[row, CEILING_SURFACE * SURFACE_VALUES] * TEXELS * TEXELS
    for high in range(_HALF):
        low = SIDE - 1 - high
        distance = SIDE - 1 - 2 * high  # from the horizon, in half pixels
        depth = _FLOOR_DEPTHS[high]
        light = _light(depth, fog)
        floor, ceiling = _packed(looks, row, FLOOR_SURFACE, light), _packed(looks, row, CEILING_SURFACE, light)
        for column in range(SIDE):
            if high < columns.top[column]:
                across = (x + (depth * columns.ray_x[column] >> RAY_BITS)) >> _TEXEL_BITS & TEXELS - 1
                down = (y + (depth * columns.ray_y[column] >> RAY_BITS)) >> _TEXEL_BITS & TEXELS - 1
                texel = across * TEXELS + down
                _put(frames, row, high, column, ceiling, patterns[ceiling_texels + texel])
                _put(frames, row, low, column, floor, patterns[floor_texels + texel])
            else:
                height = distance * columns.depth[column] // SIDE  # above the eye
                texel = (CELL // 2 - 1 - min(height, CELL // 2 - 1)) >> _TEXEL_BITS
                first = columns.texels[column]
                _put(frames, row, high, column, columns.colour[column], patterns[first + texel])
                _put(frames, row, low, column, columns.colour[column], patterns[first + TEXELS - 1 - texel])


@inline
def _paint_thing(frames: Cells, depths: Integers, row: int, kind: int, depth: int, aside: int, fog: bool) -> None:
    """Paint one thing at a depth, where it is nearer than the wall; `aside` is how far it is to the right."""
    half = _SCREEN * _SPRITE_HALVES[kind] // depth
    left = _SCREEN + _SCREEN * aside // depth - half
    top = _SCREEN + _SCREEN * (0 if kind == GOAL else _SPRITE_DROP) // depth - half
    light = _light(depth, fog)
    for column in range(max(left >> 8, 0), min((left + 2 * half >> 8) + 1, SIDE)):
        across = ((column << 8) + 128 - left) * SPRITE_TEXELS // (2 * half)
        if depth >= depths[column] or not 0 <= across < SPRITE_TEXELS:
            continue
        for line in range(max(top >> 8, 0), min((top + 2 * half >> 8) + 1, SIDE)):
            down = ((line << 8) + 128 - top) * SPRITE_TEXELS // (2 * half)
            if 0 <= down < SPRITE_TEXELS and SPRITES[kind, down, across, 3]:
                for channel in range(3):
                    frames[row, line, column, channel] = SPRITES[kind, down, across, channel] * light >> 8


@inline
def _paint_things(frames: Cells, depths: Integers, poses: Integers, things: Integers, row: int, fog: bool) -> None:
    """Paint the things before the agent, the farthest first; of equally far ones, the last in the array first."""
    cosine, sine = int(COSINES[poses[row, 2]]), int(SINES[poses[row, 2]])
    before = 1 << 60
    while True:
        farthest, aside, kind = 0, 0, 0
        for thing in range(things.shape[1]):
            x = (int(things[row, thing, 0]) << CELL_BITS) + CELL // 2 - int(poses[row, 0])
            y = (int(things[row, thing, 1]) << CELL_BITS) + CELL // 2 - int(poses[row, 1])
            order = ((x * cosine + y * sine) >> SCALE_BITS << _ORDER_BITS) + thing
            if things[row, thing, 2] != NOTHING and farthest < order < before:
                farthest, aside, kind = order, (y * cosine - x * sine) >> SCALE_BITS, int(things[row, thing, 2])
        if farthest >> _ORDER_BITS < _SPRITE_NEAR:
            return
        _paint_thing(frames, depths, row, kind, farthest >> _ORDER_BITS, aside, fog)
        before = farthest


@kernel
def draw(
    frames: Cells,
    columns: Columns,
    cells: Cells,
    poses: Integers,
    things: Integers,
    looks: Integers,
    row: int,
    fog: bool,
) -> None:
    """Draw the picture of one row, `frames[row]` [84, 84, 3].

    Args:
        frames: uint8 [N, 84, 84, 3].
        columns: Scratch space.
        cells: uint8 [N, S, S].
        poses: int64 [N, 5]: x, y, angle and velocity.
        things: int64 [N, T, 3]: x, y, kind.
        looks: int64 [N, LOOK_VALUES].
        row: Which one.
        fog: Whether light fades with depth.
    """
    _see(columns, cells, poses, looks, row, fog)
    _paint(frames, columns, _TEXTURES, poses, looks, row, fog)
    _paint_things(frames, columns.depth, poses, things, row, fog)


_TEXTURES: Final = PATTERNS.reshape(-1)
