"""Directions as integers: a circle of 4,096, with exactly rounded sines, so that all processors agree.

Direction 0 looks along x, to the right on a map; numbers grow clockwise, as y grows downwards.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

DIRECTIONS: Final = 4096
SCALE_BITS: Final = 14
"""Sines and cosines are stored times two to this power."""

_QUARTER: Final = DIRECTIONS // 4
_BITS: Final = 80  # of the fractions during the computation
_PI: Final = 3141592653589793238462643383279502884197 * (1 << _BITS) // 10**39


def _sine(index: int) -> int:
    """Return the rounded sine of a direction in the first quarter, by its power series in integers."""
    angle = 2 * _PI * index // DIRECTIONS
    total, term, order = 0, angle, 1
    while term:
        total += term
        order += 2
        term = -(term * angle * angle >> 2 * _BITS) // (order * (order - 1)) if abs(term) > 1 else 0
    return (total + (1 << _BITS - SCALE_BITS - 1)) >> _BITS - SCALE_BITS


def _sines() -> NDArray[np.int64]:
    quarter = [_sine(index) for index in range(_QUARTER + 1)]
    half = quarter + quarter[-2:0:-1]
    return np.array(half + [-value for value in half], np.int64)


SINES: Final = _sines()
COSINES: Final = np.roll(SINES, -_QUARTER)
