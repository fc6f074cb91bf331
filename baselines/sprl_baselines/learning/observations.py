"""What the networks of an agent see of an observation: its numbers, raw or normalised by what was seen so far.

One view serves the policy, the value function, ICM and the reachability network alike. It is part of each network's
state, so a checkpoint restores it and a trained policy carries it.
"""

from __future__ import annotations

from typing import Any

import torch
from gymnasium import Space, spaces
from torch import Tensor, nn

SMALLEST_VARIANCE = 1e-8  # so that a component that never changes stays near 0


class RawObservations(nn.Module):
    """Observations as they are: flat ones in single precision, grids in their own type."""

    def forward(self, observations: Tensor) -> Tensor:
        """`[B, D]` -> `[B, D]` float32; `[B, H, W, C]` -> the same."""
        return observations.float() if observations.ndim == 2 else observations

    def update(self, observations: Tensor) -> None:
        """Learn nothing."""


class NormalizedObservations(nn.Module):
    """Each component minus its running mean, divided by its running deviation, and clipped.

    The moments change in `update` alone: a rollout is acted on, priced and learned from by one view. Before the first
    update, observations are only clipped.

    Args:
        components: Numbers D in an observation.
        clip: Largest absolute value of the result.
    """

    mean: Tensor  # [D] float64
    deviation: Tensor  # [D] float64
    squares: Tensor  # [D] float64, summed squared distances from the mean
    count: Tensor  # scalar int64, observations seen

    def __init__(self, components: int, clip: float) -> None:
        super().__init__()
        self._clip = clip
        self.register_buffer("mean", torch.zeros(components, dtype=torch.float64))
        self.register_buffer("deviation", torch.ones(components, dtype=torch.float64))
        self.register_buffer("squares", torch.zeros(components, dtype=torch.float64))
        self.register_buffer("count", torch.zeros((), dtype=torch.int64))

    def forward(self, observations: Tensor) -> Tensor:
        """`[B, D]` of any number type -> `[B, D]` float32."""
        return ((observations - self.mean) / self.deviation).clamp_(-self._clip, self._clip).float()

    def update(self, observations: Tensor) -> None:
        """Take in more observations `[..., D]`, with equal weight for all that were ever seen (Chan et al. 1983)."""
        values = observations.flatten(0, -2).double()
        count, mean = len(values), values.mean(dim=0)
        total, distance = self.count + count, mean - self.mean
        self.squares += (values - mean).square().sum(dim=0) + distance.square() * self.count * count / total
        self.mean += distance * count / total
        self.count += count
        self.deviation.copy_((self.squares / total + SMALLEST_VARIANCE).sqrt())


View = RawObservations | NormalizedObservations
RAW = RawObservations()


def view_of(space: Space[Any], *, normalize: bool, clip: float) -> View:
    """Return the view for observations of one sub-env.

    Raises:
        ValueError: Observations are to be normalised, and are not a flat `Box`.
    """
    if not normalize:
        return RawObservations()
    if not isinstance(space, spaces.Box) or len(space.shape) != 1:
        raise ValueError(f"normalize_observations is True; it must be False where observations are in {space}.")
    return NormalizedObservations(space.shape[0], clip)
