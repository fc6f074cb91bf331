"""What the sub-envs showed lately, first in, first out, and where one stretch of it ends and another begins."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import torch
from torch import Tensor


class Segments(NamedTuple):
    """S stretches of successive states without an ending or a reward between them, as places in a replay."""

    starts: Tensor  # [S] int64, place of the first state
    lengths: Tensor  # [S] int64, how many states


class Replay:
    """The last `size` states of N sub-envs, in the environment's own dtype.

    A state's place is sub-env x rows + row, rows counted from the oldest, so successive states have successive places.

    Args:
        size: States in all; every sub-env keeps its last `size // num_envs`.
        num_envs: Sub-envs N.
    """

    def __init__(self, size: int, num_envs: int) -> None:
        self.capacity = max(size // num_envs, 1)  # rows
        self._states = torch.empty(0)  # [N, R, ...]
        self._cuts = torch.empty(num_envs, 0, dtype=torch.bool)  # [N, R]

    @property
    def rows(self) -> int:
        """States of each sub-env."""
        return self._cuts.shape[1]

    def append(self, states: Tensor, cuts: Tensor) -> None:
        """Take in T more steps, and let go of the oldest.

        Args:
            states: What was acted on, `[T, N, ...]`.
            cuts: Whether the step from it ended an episode or was rewarded, `[T, N]` bool.
        """
        states, cuts = states.transpose(0, 1), cuts.transpose(0, 1)
        if self.rows:
            states, cuts = (
                torch.cat((self._states, states), dim=1),
                torch.cat((self._cuts.to(cuts.device), cuts), dim=1),
            )
        self._states = states[:, -self.capacity :].contiguous()
        self._cuts = cuts[:, -self.capacity :].contiguous()

    def take(self, places: Tensor) -> Tensor:
        """Return the states at these places, `[B, ...]`."""
        return self._states.flatten(0, 1).index_select(0, places.to(self._states.device))

    def segments(self, newest: int | None = None) -> Segments:
        """Return all stretches, oldest first within a sub-env; of the newest rows alone if a number is given."""
        cuts = self._cuts.cpu().clone()
        first = 0 if newest is None else max(self.rows - newest, 0)
        cuts[:, -1] = True
        ends = cuts.flatten().nonzero().squeeze(1)
        starts = torch.cat((ends.new_zeros(1), ends[:-1] + 1))
        row_of_start, row_of_end = starts % self.rows, ends % self.rows
        starts = starts + (first - row_of_start).clamp(min=0)
        recent = row_of_end >= first
        return Segments(starts[recent], (ends - starts + 1)[recent])

    def state_dict(self) -> dict[str, Any]:
        """Return all states and cuts."""
        return {"states": self._states.clone(), "cuts": self._cuts.clone()}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Take such states and cuts."""
        self._states, self._cuts = state["states"], state["cuts"]
