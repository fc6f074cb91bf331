"""What a vector environment is made and reset with, checked: which sub-environments, when, and for how long."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np
from gymnasium.error import ResetNeeded
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from sprl_bench.envs.arguments import check_choice, check_integer

__all__ = ["ARGUMENTS", "NEVER", "checked_autoreset_mode", "checked_mask", "checked_time_limit"]

ARGUMENTS: Final = ("num_envs", "autoreset_mode", "num_threads", "max_episode_steps", "render_mode", "copy")
"""What every batched engine takes."""
NEVER: Final = np.iinfo(np.int64).max
"""A number of steps that no episode reaches."""


def checked_autoreset_mode(value: object) -> AutoresetMode:
    """Return the mode that Gymnasium's enum or its string names.

    Raises:
        ValueError: It names none.
    """
    if not isinstance(value, AutoresetMode):
        check_choice("autoreset_mode", value, [mode.value for mode in AutoresetMode])
    return AutoresetMode(value)


def checked_time_limit(max_episode_steps: int | None) -> int:
    """Return the limit, or ``NEVER`` where there is none.

    Raises:
        TypeError, ValueError: It is neither a positive integer nor None nor -1.
    """
    if max_episode_steps is None or (max_episode_steps == -1 and not isinstance(max_episode_steps, bool)):
        return NEVER
    return check_integer("max_episode_steps", max_episode_steps, 1)


def checked_mask(options: Mapping[str, Any] | None, num_envs: int, *, first: bool) -> NDArray[np.bool_]:
    """Return which sub-environments to reset, bool [N].

    Args:
        options: As ``reset`` takes them.
        num_envs: Number of sub-environments N.
        first: Whether nothing has been reset yet.

    Raises:
        TypeError, ValueError: ``options["reset_mask"]`` is no mask of N with at least one True.
        ResetNeeded: The first reset leaves out a sub-environment.
    """
    if options is None or "reset_mask" not in options:
        return np.ones(num_envs, np.bool_)
    mask = options["reset_mask"]
    if not isinstance(mask, np.ndarray) or mask.dtype != np.bool_:
        got = mask.dtype if isinstance(mask, np.ndarray) else type(mask).__name__
        raise TypeError(f"options['reset_mask'] must be a NumPy array of bool, got {got}.")
    if mask.shape != (num_envs,) or not mask.any():
        raise ValueError(f"options['reset_mask'] must have shape ({num_envs},) and at least one True, got {mask!r}.")
    if first and not mask.all():
        raise ResetNeeded("The first reset() must reset all sub-environments.")
    return mask
