"""Percentiles of many samples: those of `numpy.percentile` to the last bit, found by selection instead of sorting."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


def central_range_in_place(values: Array, confidence: float) -> tuple[Array, Array]:
    """Return the ends of the central range of samples, which it reorders.

    Args:
        values: [..., R] for R samples; their order is lost.
        confidence: The share of the samples that the range holds.

    Returns:
        The lower and the upper ends, each [...].
    """
    tail = 100 * (1 - confidence) / 2
    low, high = np.array([tail, 100 - tail]) / 100 * (values.shape[-1] - 1)
    return _between(values, low), _between(values, high)


def _between(values: Array, place: np.float64) -> Array:
    """Return what lies at a place in the sorted samples, 0 for the smallest, by linear interpolation: [...]."""
    below = int(place)
    share = place - below
    values.partition(below, axis=-1)
    left, rest = values[..., below], values[..., below + 1 :]
    right = rest.min(axis=-1) if rest.shape[-1] else left
    step = right - left
    return np.asarray(left + step * share if share < 0.5 else right - step * (1 - share))
