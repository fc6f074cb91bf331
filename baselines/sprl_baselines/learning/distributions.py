"""The two action distributions of a policy: categorical and diagonal Gaussian.

`torch.distributions` cannot sample from the agent's own generator; these can.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import torch
from torch import Tensor


class Distribution(Protocol):
    """A batch of B independent distributions over actions."""

    def sample(self, generator: torch.Generator) -> Tensor:
        """Draw one action from each: `[B]` for discrete actions, `[B, A]` for continuous ones."""

    def log_prob(self, actions: Tensor) -> Tensor:
        """Return the log-probability (or log-density) of the given actions, `[B]`."""

    def entropy(self) -> Tensor:
        """Return the entropy in nats, `[B]`."""


@dataclass(frozen=True)
class Categorical:
    """A choice among A actions."""

    log_probabilities: Tensor  # [B, A], normalised

    def sample(self, generator: torch.Generator) -> Tensor:
        """Draw by an exponential race: the first of A clocks with the actions' probabilities as rates."""
        clocks = torch.empty_like(self.log_probabilities).exponential_(generator=generator)
        return (self.log_probabilities - clocks.log_()).argmax(dim=-1)

    def log_prob(self, actions: Tensor) -> Tensor:
        """Return the log-probability of `actions` `[B]`, `[B]`."""
        return self.log_probabilities.gather(-1, actions.unsqueeze(-1)).squeeze(-1)

    def entropy(self) -> Tensor:
        """Return the entropy in nats, `[B]`."""
        return -(self.log_probabilities.exp() * self.log_probabilities).sum(dim=-1)


@dataclass(frozen=True)
class DiagonalGaussian:
    """Independent normal components with the same standard deviations in all states."""

    mean: Tensor  # [B, A]
    log_std: Tensor  # [A]

    def sample(self, generator: torch.Generator) -> Tensor:
        """Draw `[B, A]`, not clipped to the action space, because `log_prob` is the density of the unclipped draw."""
        noise = torch.empty_like(self.mean).normal_(generator=generator)
        return self.mean + self.log_std.exp() * noise

    def log_prob(self, actions: Tensor) -> Tensor:
        """Return the log-density of `actions` `[B, A]`, `[B]`."""
        standardised = (actions - self.mean) * (-self.log_std).exp()
        return (-0.5 * standardised.square() - self.log_std - _HALF_LOG_TWO_PI).sum(dim=-1)

    def entropy(self) -> Tensor:
        """Return the entropy in nats, `[B]`."""
        return (self.log_std + 0.5 + _HALF_LOG_TWO_PI).sum().expand(len(self.mean))


_HALF_LOG_TWO_PI = 0.5 * math.log(2 * math.pi)
