"""The forms in which an agent may see a grid. They hold the same information, so task and score do not depend on them.

- `"cells"` uint8 [S, S, 3]: the numbers of each cell, as in `encoding`;
- `"flat"` uint8 [S * S * 3]: the same numbers in one row;
- `"one-hot"` float32 [S * S * 11]: for each cell, a 1 at the number of what is there.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from gymnasium.spaces import Box
from numpy.typing import NDArray

from sprl_bench.envs.grid.encoding import AGENT, DOOR, EMPTY, GOAL, KEY, WALL

CELLS: Final = "cells"
FLAT: Final = "flat"
ONE_HOT: Final = "one-hot"
FORMS: Final = (CELLS, FLAT, ONE_HOT)

THINGS: Final = (
    (EMPTY, 0), (WALL, 0), (KEY, 0), (GOAL, 0),
    (DOOR, 0), (DOOR, 1), (DOOR, 2),
    (AGENT, 0), (AGENT, 1), (AGENT, 2), (AGENT, 3),
)  # fmt: skip
"""(type, state) of whatever can be in a cell; its place here is its place in a one-hot cell."""

_ROWS: Final = np.zeros((AGENT + 1, 4, len(THINGS)), np.float32)
for _number, (_type, _state) in enumerate(THINGS):
    _ROWS[_type, _state, _number] = 1
_ROWS.flags.writeable = False


def space_of(form: str, size: int) -> Box:
    """Return the space of one observation of a grid with `size` x `size` cells."""
    if form == ONE_HOT:
        return Box(0, 1, (size * size * len(THINGS),), np.float32)
    return Box(0, 255, (size, size, 3) if form == CELLS else (size * size * 3,), np.uint8)


def shown(form: str, cells: NDArray[np.uint8]) -> NDArray[Any]:
    """Return grids in one of the `FORMS`.

    Args:
        form: Which one.
        cells: Whole grids, uint8 [..., S, S, 3].

    Returns:
        `cells` itself, or [..., S * S * K].
    """
    if form == CELLS:
        return cells
    parts = cells if form == FLAT else _ROWS[cells[..., 0], cells[..., 2]]
    return parts.reshape(*cells.shape[:-3], -1)
