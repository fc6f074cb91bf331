"""What tells the observations of a grid world from others."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium import Space, spaces

__all__ = ["grid_shape"]

CELL = 3  # numbers for a cell: type, colour, and state or direction


def grid_shape(space: Space[Any]) -> tuple[int, int, int] | None:
    """Return height, width and frames of grids, uint8 `[H, W, 3 * frames]`, or None where observations are none."""
    match space:
        case spaces.Box(shape=(height, width, numbers), dtype=np.uint8) if numbers and numbers % CELL == 0:
            return height, width, numbers // CELL
        case _:
            return None
