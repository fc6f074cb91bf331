"""Patterns for surfaces, and pictures of the things, made by integer formulas.

A pattern is brightness only; the colours of surfaces are drawn for each episode. The pictures of things are always the
same, so that an agent can know them.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

Shape = tuple[NDArray[np.bool_], tuple[int, int, int]]
"""Where a shape is, and its colour."""

TEXELS: Final = 32  # along a side of a pattern, which covers one cell
SPRITE_TEXELS: Final = 16
WHITE: Final = (255, 255, 255)
_GOLD, _RED = (255, 205, 40), (225, 30, 30)
_GREEN, _LEAF = (40, 200, 60), (15, 120, 30)
_VIOLET, _BLACK = (165, 60, 220), (20, 20, 20)


def _patterns() -> NDArray[np.uint8]:
    """Return all patterns, uint8 [2 P, column, row from the top]: those of walls, then calmer ones of the ground."""
    u, v = np.indices((TEXELS, TEXELS))
    across, down = 2 * u - TEXELS + 1, 2 * v - TEXELS + 1  # from the middle
    bright = np.array(
        [
            (u // 8 + v // 8) % 2,  # squares
            (u // 4) % 2,  # stripes
            (v // 4) % 2,
            ((u + v) // 8) % 2,
            (v % 8 != 0) & ((u + v // 8 * 8) % 16 != 0),  # bricks
            (u % 16 > 1) & (v % 16 > 1),  # tiles
            np.maximum(abs(across), abs(down)) < 24,  # a frame
            across**2 + down**2 < 500,  # a disc
            (abs(across) + abs(down)) // 12 % 2,  # rhombs
            (abs(across) < 9) | (abs(down) < 9),  # a cross
            (across**2 + down**2) // 220 % 2,  # rings
            (u // 4 * 40503 ^ v // 4 * 30011) * 2654435761 // 65536 % 2,  # noise
        ]
    )
    grain = (u * 7919 ^ v * 104729) * 2654435761 // 65536 % 24
    return np.concatenate([105 + 125 * bright + grain, 150 + 45 * bright + grain]).astype(np.uint8)


def _draw(*shapes: Shape) -> NDArray[np.uint8]:
    """Return a picture uint8 [row, column, (red, green, blue, opaque)]; later shapes cover earlier ones."""
    picture = np.zeros((SPRITE_TEXELS, SPRITE_TEXELS, 4), np.uint8)
    for mask, colour in shapes:
        picture[mask] = (*colour, 1)
    return picture


def _sprites() -> NDArray[np.uint8]:
    """Return the pictures of the kinds of things, uint8 [kind, row, column, 4]; nothing is transparent."""
    row, column = 2 * np.indices((SPRITE_TEXELS, SPRITE_TEXELS)) - SPRITE_TEXELS + 1
    square, rhomb, disc = np.maximum(abs(row), abs(column)), abs(row) + abs(column), row**2 + column**2
    return np.stack(
        [
            _draw(),
            _draw((rhomb <= 16, WHITE), (rhomb <= 12, _GOLD), (rhomb <= 6, _RED)),
            _draw((disc <= 226, WHITE), (disc <= 160, _GREEN), (disc <= 30, _LEAF)),
            _draw((square <= 15, WHITE), (square <= 11, _VIOLET), (abs(row) == abs(column), _BLACK)),
        ]
    )


PATTERNS: Final = _patterns()
SPRITES: Final = _sprites()
NUM_PATTERNS: Final = len(PATTERNS) // 2
"""Patterns of walls; floor and ceiling have those that many places later."""
