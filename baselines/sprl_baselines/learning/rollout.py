"""A rollout: what the agent saw and did for T steps of N sub-environments.

Many observations repeat. In a grid world many steps change nothing (the agent walks into a wall), and short episodes
visit the same states again. A rollout finds its distinct observations once, and `compute_once` computes a network's
outputs for each of them once.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TypeVar

import numpy as np
import torch
from torch import Tensor

Outputs = TypeVar("Outputs", Tensor, tuple[Tensor, Tensor])


@dataclass(frozen=True)
class Rows:
    """Rows that may repeat, stored as the D distinct ones and the place of each row among them."""

    distinct: Tensor  # [D, ...]
    places: Tensor  # [B] int64, or of more dimensions

    @classmethod
    def of(cls, rows: Tensor) -> Rows:
        """Find the distinct rows of `[B, ...]`, in order of appearance. Two rows are the same if their bytes are."""
        first, places = _numbered(row.tobytes() for row in rows.cpu().numpy())
        return cls(rows[first.to(rows.device)], places.to(rows.device))

    def __len__(self) -> int:
        return len(self.places)

    def __getitem__(self, indices: Tensor | slice) -> Rows:
        """Return the rows at these indices."""
        return Rows(self.distinct, self.places[indices])

    def __add__(self, others: Rows) -> Rows:
        """Return these rows, then the others."""
        both = Rows.of(torch.cat((self.distinct, others.distinct)))
        places = torch.cat((self.places, others.places + len(self.distinct)))
        return Rows(both.distinct, both.places[places])

    def in_order(self) -> Rows:
        """Return the same rows with only the distinct ones that occur, in order of appearance."""
        occurring = self.places.flatten()
        first, places = _numbered(occurring.tolist())
        distinct = self.distinct[occurring[first.to(occurring.device)]]
        return Rows(distinct, places.to(occurring.device).view_as(self.places))

    def expanded(self) -> Tensor:
        """Return all rows, repeated where they repeat."""
        return self.distinct[self.places]

    def through(self, network: Callable[[Tensor], Outputs]) -> Outputs:
        """Return the network's outputs for all rows; it sees each distinct row once."""
        return compute_once(lambda places: network(self.distinct.index_select(0, places)), self.places)


def _numbered(keys: Iterable[Hashable]) -> tuple[Tensor, Tensor]:
    """Number keys by first appearance: the index where each distinct key appears first `[D]`, all numbers `[B]`."""
    seen: dict[Hashable, int] = {}
    numbers = np.array([seen.setdefault(key, len(seen)) for key in keys], dtype=np.int64)
    return torch.from_numpy(np.unique(numbers, return_index=True)[1]), torch.from_numpy(numbers)


def compute_once(function: Callable[[Tensor], Outputs], keys: Tensor) -> Outputs:
    """Return a function's outputs for all keys; it sees each distinct key once, in ascending order.

    Args:
        function: Takes keys `[D]`, and returns one or two tensors `[D, ...]`.
        keys: Whole numbers, of any shape.
    """
    needed, places = keys.unique(return_inverse=True)  # type: ignore[no-untyped-call] # torch has no types there

    def spread(output: Tensor) -> Tensor:
        return output.index_select(0, places.flatten()).view(*places.shape, *output.shape[1:])

    outputs = function(needed)
    if isinstance(outputs, Tensor):
        return spread(outputs)
    return spread(outputs[0]), spread(outputs[1])


@dataclass(frozen=True)
class Rollout:
    """T steps of N sub-environments: data to read, never to write.

    `observations[t]` is what the agent acted on. Where an episode ended with step t, row t + 1 is the first
    observation of the next one, and the true successor is among `final_observations`.
    """

    observations: Tensor  # [T, N, ...] in the environment's dtype
    actions: Tensor  # [T, N] or [T, N, A], as drawn from the policy
    rewards: Tensor  # [T, N] float32, the environment's own, never modified
    terminated: Tensor  # [T, N] bool, the task ended
    truncated: Tensor  # [T, N] bool, a time limit ended the episode
    values: Tensor  # [T, N] float32, of `observations`
    log_probs: Tensor  # [T, N] float32, of `actions`
    last_observations: Tensor  # [N, ...] what the agent will act on next
    final_observations: Tensor  # [E, ...] true successors of the E ending steps, step by step, env by env
    positions: Tensor  # [T, N, 2] int64, the agent's (x, y) at `observations`; [T, N, 0] where there is none
    next_positions: Tensor  # [T, N, 2] int64, at the true successors; [T, N, 0] where there is none

    @property
    def num_steps(self) -> int:
        """Env steps in all, T x N."""
        return self.rewards.numel()

    @cached_property
    def ended(self) -> Tensor:
        """Whether an episode ended with this step, by termination or truncation, `[T, N]` bool."""
        return self.terminated | self.truncated

    @cached_property
    def cuts(self) -> Tensor:
        """Whether the step ended an episode or was rewarded, `[T, N]` bool: no stretch continues past it."""
        return self.ended | (self.rewards != 0)

    @cached_property
    def _seen(self) -> Rows:
        """All observations: T x N that were acted on, N last ones, E final ones."""
        return Rows.of(torch.cat((self.observations.flatten(0, 1), self.last_observations, self.final_observations)))

    @property
    def observed(self) -> Rows:
        """`observations`, step by step, `[T * N]`."""
        return self._seen[: self.num_steps]

    @property
    def visited(self) -> Rows:
        """`observations`, then `last_observations`, step by step, `[(T + 1) * N]`; no terminal state is among them."""
        return self._seen[: self.num_steps + len(self.last_observations)].in_order()

    @cached_property
    def transitions(self) -> Rows:
        """The observation and the true successor of every step, `[T * N, 2]`."""
        places, num_envs = self._seen.places, len(self.last_observations)
        before, after = places[: self.num_steps], places[num_envs : self.num_steps + num_envs].clone()
        after[self.ended.flatten()] = places[self.num_steps + num_envs :]
        return Rows(self._seen.distinct, torch.stack((before, after), dim=1)).in_order()

    @property
    def next_observations(self) -> Tensor:
        """The true successor of every step, `[T, N, ...]`."""
        return self.transitions.expanded()[:, 1].view_as(self.observations)

    def newest(self, stack: int) -> Rollout:
        """Return the same steps with each observation alone, without the `stack` earlier ones joined to it."""
        if stack == 0:
            return self
        joined = ("observations", "last_observations", "final_observations")
        size = self.observations.shape[-1] // (stack + 1)
        return replace(self, **{name: getattr(self, name)[..., -size:] for name in joined})
