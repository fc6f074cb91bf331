"""The check of a batch of discrete actions."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from sprl_bench.envs.compiled import kernel

Integers = NDArray[np.int64]
Flags = NDArray[np.bool_]


class DiscreteActions:
    """Checks the actions of N sub-environments, and returns them in one type: the kernels are compiled for that.

    Args:
        num_envs: Number of sub-environments N.
        highest: The highest action; the lowest is 0.
    """

    def __init__(self, num_envs: int, highest: int) -> None:
        self._highest = highest
        self._actions = np.zeros(num_envs, np.int64)

    def checked(self, actions: Any, skipped: Flags) -> Integers:
        """Return the actions [N], in an array that the next call fills again.

        Args:
            actions: Integers [N].
            skipped: Which sub-environments ignore their action, [N]; it may be out of range.

        Raises:
            TypeError: `actions` are not integers [N].
            ValueError: An action is out of range.
        """
        given = np.asarray(actions)
        if given.shape != self._actions.shape or given.dtype.kind not in "iu":
            raise TypeError(
                f"actions is {given.dtype} of shape {given.shape}; "
                f"it must be integers of shape ({len(self._actions)},)."
            )
        self._actions[:] = given
        row = _first_invalid(self._actions, skipped, self._highest)
        if row >= 0:
            raise ValueError(f"actions[{row}] is {given[row]}; it must be an integer from 0 to {self._highest}.")
        return self._actions


@kernel
def _first_invalid(actions: Integers, skipped: Flags, highest: int) -> int:
    """Return the first row that is not skipped and has an action out of range, or -1."""
    for row in range(actions.shape[0]):
        if (actions[row] < 0 or actions[row] > highest) and not skipped[row]:
            return row
    return -1
