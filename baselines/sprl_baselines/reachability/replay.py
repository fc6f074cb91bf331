"""The most recent states of all sub-envs, first in, first out, and the stretches between rewards and endings."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import torch
from torch import Tensor


class Segments(NamedTuple):
    """S stretches of successive states, without a reward or the end of an episode between them."""

    starts: Tensor  # [S] int64, place of the first state in the replay
    lengths: Tensor  # [S] int64, number of states


class Replay:
    """The last `size` states of N sub-envs, in the environment's own dtype, in a ring.

    A state's place is sub-env x rows + row, rows counted from the oldest, so successive states have successive places.

    Args:
        size: States in all; every sub-env keeps its last `size // num_envs`.
        num_envs: Sub-envs N.
    """

    def __init__(self, size: int, num_envs: int) -> None:
        self.capacity = max(size // num_envs, 1)  # rows
        self.rows = 0  # states of each sub-env
        self._next = 0  # where in the ring the next row goes; the oldest is there once the ring is full
        self._states = torch.empty(0)  # [R, N, ...]
        self._cuts = torch.zeros(self.capacity, num_envs, dtype=torch.bool)  # [R, N], on the CPU

    def append(self, states: Tensor, cuts: Tensor) -> None:
        """Add T more steps, and drop the oldest.

        Args:
            states: The observations acted on, `[T, N, ...]`.
            cuts: Whether the step from there ended an episode or was rewarded, `[T, N]` bool.
        """
        if not len(self._states):
            self._states = states.new_zeros(self.capacity, *states.shape[1:])
        states, cuts = states[-self.capacity :], cuts[-self.capacity :].cpu()
        rows = (self._next + torch.arange(len(cuts))) % self.capacity
        self._states[rows.to(states.device)] = states
        self._cuts[rows] = cuts
        self._next = (self._next + len(cuts)) % self.capacity
        self.rows = min(self.rows + len(cuts), self.capacity)

    def take(self, places: Tensor) -> Tensor:
        """Return the states at these places, `[B, ...]`."""
        envs, rows = places // self.rows, self._in_ring(places % self.rows)
        device = self._states.device
        return self._states[rows.to(device), envs.to(device)]

    def _in_ring(self, rows: Tensor) -> Tensor:
        """Return the positions in the ring of rows counted from the oldest."""
        oldest = self._next if self.rows == self.capacity else 0
        return (oldest + rows) % self.capacity

    def segments(self, newest: int | None = None) -> Segments:
        """Return all stretches, oldest first in each sub-env; with `newest`, only those in that many newest rows."""
        first = 0 if newest is None else max(self.rows - newest, 0)
        cuts = self._cuts[self._in_ring(torch.arange(self.rows))]
        cuts[-1] = True
        ends = cuts.T.flatten().nonzero().squeeze(1)
        starts = torch.cat((ends.new_zeros(1), ends[:-1] + 1))
        starts = starts + (first - starts % self.rows).clamp(min=0)
        recent = ends % self.rows >= first
        return Segments(starts[recent], (ends - starts + 1)[recent])

    def state_dict(self) -> dict[str, Any]:
        """Return all states and cuts."""
        return {"states": self._states.clone(), "cuts": self._cuts.clone(), "rows": self.rows, "next": self._next}

    def load_state_dict(self, state: Mapping[str, Any], device: torch.device) -> None:
        """Restore such states, on `device`, and cuts."""
        self._states, self._cuts = state["states"].to(device, copy=True), state["cuts"].cpu().clone()
        self.rows, self._next = int(state["rows"]), int(state["next"])
