"""What tells the observations of a grid world from others."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium import Space, spaces

CELL = 3  # numbers for a cell: type, colour, and state or direction
LARGEST = 32  # cells along a side; what is larger is an image
GRIDS = f"(H, W, {CELL}) uint8 of at most {LARGEST} cells a side"
SQUARE_GRID = GRIDS.replace("H, W", "S, S")


def grid_shape(space: Space[Any]) -> tuple[int, int, int] | None:
    """Return height, width and frames of grids, uint8 `[H, W, 3 * frames]`, or None where observations are none.

    Images have such observations too; they are told from grids by their size.
    """
    match space:
        case spaces.Box(shape=(height, width, numbers), dtype=np.uint8) if (
            numbers and numbers % CELL == 0 and max(height, width) <= LARGEST
        ):
            return height, width, numbers // CELL
        case _:
            return None
