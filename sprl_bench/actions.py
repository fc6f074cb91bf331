"""Uniform random actions for a vector environment: those of the fingerprint and of the random agent."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from gymnasium import Space, spaces


def uniform_actions(space: Space[Any], count: int, generator: np.random.Generator) -> npt.NDArray[Any]:
    """Draw `[N]` discrete or `[N, A]` continuous actions.

    Raises:
        ValueError: The space is neither `Discrete` nor a bounded `Box`.
    """
    if isinstance(space, spaces.Discrete):
        return generator.integers(space.start, space.start + space.n, size=count, dtype=np.int64)
    if isinstance(space, spaces.Box) and space.is_bounded():
        return generator.uniform(space.low, space.high, size=(count, *space.shape)).astype(space.dtype)
    raise ValueError(f"action_space is {space}; it must be Discrete or a bounded Box.")
