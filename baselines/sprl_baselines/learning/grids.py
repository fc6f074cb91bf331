"""How the observations of a grid world are recognised."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium import Space, spaces

CELL = 3  # numbers for a cell: type, colour, and state or direction
LARGEST = 32  # cells along a side; anything larger is an image
GRIDS = f"(H, W, {CELL}) uint8 with at most {LARGEST} cells along each side"
SQUARE_GRID = GRIDS.replace("H, W", "S, S")


def grid_shape(space: Space[Any]) -> tuple[int, int, int] | None:
    """Return height, width and frames of grids, uint8 `[H, W, 3 * frames]`; None for other observations.

    Images can have the same dtype and number of channels; a side longer than 32 marks them.
    """
    match space:
        case spaces.Box(shape=(height, width, numbers), dtype=np.uint8) if (
            numbers and numbers % CELL == 0 and max(height, width) <= LARGEST
        ):
            return height, width, numbers // CELL
        case _:
            return None


def square_grid_side(space: Space[Any]) -> int:
    """Return the number of cells S along each side of square grids of one frame, `[S, S, 3]`.

    Raises:
        ValueError: The observations are not such grids.
    """
    match grid_shape(space):
        case (height, width, 1) if height == width:
            return height
        case _:
            raise ValueError(f"observation_space is {space}; it must be {SQUARE_GRID}.")
