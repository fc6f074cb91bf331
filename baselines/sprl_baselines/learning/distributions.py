"""The two action distributions of a policy: categorical, and diagonal Gaussian.

They do what the learner needs and nothing else; sampling takes the agent's own generator, which those of
`torch.distributions` cannot.
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
        """Draw one action each: `[B]` for discrete actions, `[B, A]` for continuous ones."""

    def mode(self) -> Tensor:
        """The most likely action of each."""

    def log_prob(self, actions: Tensor) -> Tensor:
        """Log-probability (or log-density) of the given actions, `[B]`."""

    def entropy(self) -> Tensor:
        """Entropy in nats, `[B]`."""

    def take(self, indices: Tensor) -> Distribution:
        """The distributions at these indices, which may repeat."""


@dataclass(frozen=True)
class Categorical:
    """One of several actions, by normalised log-probabilities `[B, A]`."""

    log_probabilities: Tensor  # [B, A]

    @classmethod
    def from_logits(cls, logits: Tensor) -> Categorical:
        """Normalise `logits` `[B, A]`."""
        return cls(logits.log_softmax(dim=-1))

    def sample(self, generator: torch.Generator) -> Tensor:
        """Draw by an exponential race: the first of A clocks with the actions' probabilities as rates."""
        clocks = torch.empty_like(self.log_probabilities).exponential_(generator=generator)
        return (self.log_probabilities - clocks.log_()).argmax(dim=-1)

    def mode(self) -> Tensor:
        """The most likely action of each, `[B]`."""
        return self.log_probabilities.argmax(dim=-1)

    def log_prob(self, actions: Tensor) -> Tensor:
        """Log-probability of `actions` `[B]`, `[B]`."""
        return self.log_probabilities.gather(-1, actions.unsqueeze(-1)).squeeze(-1)

    def entropy(self) -> Tensor:
        """Entropy in nats, `[B]`."""
        return -(self.log_probabilities.exp() * self.log_probabilities).sum(dim=-1)

    def take(self, indices: Tensor) -> Categorical:
        """The distributions at these indices."""
        return Categorical(self.log_probabilities.index_select(0, indices))


@dataclass(frozen=True)
class DiagonalGaussian:
    """Independent normal components, by mean `[B, A]` and one log standard deviation `[A]` for all states."""

    mean: Tensor  # [B, A]
    log_std: Tensor  # [A]

    def sample(self, generator: torch.Generator) -> Tensor:
        """Draw `[B, A]`, not clipped to the action space: the density belongs to the draw as it is."""
        noise = torch.empty_like(self.mean).normal_(generator=generator)
        return self.mean + self.log_std.exp() * noise

    def mode(self) -> Tensor:
        """The most likely action of each, `[B, A]`."""
        return self.mean

    def log_prob(self, actions: Tensor) -> Tensor:
        """Log-density of `actions` `[B, A]`, `[B]`."""
        standardised = (actions - self.mean) * (-self.log_std).exp()
        return (-0.5 * standardised.square() - self.log_std - _HALF_LOG_TWO_PI).sum(dim=-1)

    def entropy(self) -> Tensor:
        """Entropy in nats, `[B]`."""
        return (self.log_std + 0.5 + _HALF_LOG_TWO_PI).sum().expand(len(self.mean))

    def take(self, indices: Tensor) -> DiagonalGaussian:
        """The distributions at these indices."""
        return DiagonalGaussian(self.mean.index_select(0, indices), self.log_std)


_HALF_LOG_TWO_PI = 0.5 * math.log(2 * math.pi)
