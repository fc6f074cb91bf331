"""The network that judges pairs: an embedding of each state, and a head for two embeddings.

Grids: the policy's three convolutions and a fully connected layer for each state, all with CReLU (appendix D.3), then a
head, which the paper does not describe. Images: a residual network for each state, then a head (appendix E.4). Flat
observations: only the head (appendix G.4).
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from typing import Any

import torch
from gymnasium import Space, spaces
from torch import Tensor, nn

from sprl_baselines.learning.grids import GRIDS, grid_shape
from sprl_baselines.learning.images import IMAGES, image_shape
from sprl_baselines.learning.initialization import CRELU_GAIN, RELU_GAIN, VALUE_GAIN, linear
from sprl_baselines.learning.networks import CReLU, grid_convolutions
from sprl_baselines.learning.observations import RAW, View
from sprl_baselines.reachability.residual import SMALL, residual_embedding

IMAGES_AT_ONCE = 256  # embedded in one pass, which bounds the memory
PAIR_INPUTS = ("pair", "difference")

Comparison = Callable[[Tensor, Tensor], Tensor]
"""Takes indices `[P]` of earlier and of later states, and returns logits `[P]`."""


class ReachabilityNetwork(nn.Module):
    """Gives the probability that the first of two states leads to the second within k steps, as a logit.

    Args:
        embedding: Turns B states, or differences of states, into features `[B, E]`.
        features: E.
        layers: Hidden layers of the head.
        units: Width H of each.
        pair_input: "pair" for both states; "difference" for the later state and its difference from the earlier one,
            number by number (appendix F.4).
        at_once: The most states, or differences, that are embedded in one pass outside of training; None for all.
        generator: Generator of the initial parameters, on the CPU.
    """

    def __init__(
        self,
        embedding: nn.Module,
        features: int,
        *,
        layers: int,
        units: int,
        pair_input: str,
        generator: torch.Generator,
        at_once: int | None = None,
    ) -> None:
        super().__init__()
        self._at_once = at_once
        self.embedding = embedding
        self.first = linear(2 * features, units, RELU_GAIN, generator)
        self.difference = pair_input == "difference"
        hidden = [
            module
            for fan_in, fan_out in pairwise([units] * layers)
            for module in (nn.BatchNorm1d(fan_in), nn.ReLU(), linear(fan_in, fan_out, RELU_GAIN, generator))
        ]
        self.rest = nn.Sequential(*hidden, nn.BatchNorm1d(units), nn.ReLU(), linear(units, 1, VALUE_GAIN, generator))

    def forward(self, states: Tensor) -> Comparison:
        """Embed D states `[D, ...]` once, and return a function that compares pairs of them."""
        return self._differences(states) if self.difference else self._pairs(states)

    def _pairs(self, states: Tensor) -> Comparison:
        """Compute the head's first layer for each state: it is linear, so a pair is a sum."""
        features = self._embedded(states)
        as_earlier, as_later = (features @ weight.T for weight in self.first.weight.chunk(2, dim=1))

        def logits(earlier: Tensor, later: Tensor) -> Tensor:
            found: Tensor = self.rest(as_earlier[earlier] + as_later[later] + self.first.bias).squeeze(-1)
            return found

        return logits

    def _differences(self, states: Tensor) -> Comparison:
        """Embed the later states once, and the difference of every pair."""
        features = self._embedded(states)

        def logits(earlier: Tensor, later: Tensor) -> Tensor:
            parts = zip(self._parts(earlier), self._parts(later), strict=True)
            changes = [self.embedding(states[after].float() - states[before].float()) for before, after in parts]
            change = torch.cat(changes) if len(changes) > 1 else changes[0]
            found: Tensor = self.rest(self.first(torch.cat((features[later], change), dim=1))).squeeze(-1)
            return found

        return logits

    def _embedded(self, states: Tensor) -> Tensor:
        """Embed states in parts, `[D, ...]` -> `[D, E]`."""
        parts = [self.embedding(part) for part in self._parts(states)]
        return torch.cat(parts) if len(parts) > 1 else parts[0]

    def _parts(self, rows: Tensor) -> tuple[Tensor, ...]:
        """Split rows; not in training, where a batch is normalised as a whole."""
        return (rows,) if self._at_once is None or self.training else torch.split(rows, self._at_once)


def reachability_network(
    observation_space: Space[Any],
    generator: torch.Generator,
    *,
    view: View = RAW,
    embedding_units: int,
    layers: int,
    units: int,
    pair_input: str,
    blocks: tuple[int, ...] = SMALL,
) -> ReachabilityNetwork:
    """Return the network for observations of one sub-env: grids, images, or a flat `Box`.

    Args:
        observation_space: Of one sub-env.
        generator: Generator of the initial parameters, on the CPU.
        view: What the network sees of an observation.
        embedding_units: Units that embed a grid or an image.
        layers: Hidden layers of the head.
        units: Width of each.
        pair_input: See `ReachabilityNetwork`.
        blocks: Residual blocks in each group, for images.

    Raises:
        ValueError: There is no network for these observations.
    """
    if grid := grid_shape(observation_space):
        convolutions, features = grid_convolutions(*grid, generator)
        units_of_a_state = linear(features, embedding_units, CRELU_GAIN, generator)
        embedding = nn.Sequential(view, *convolutions, units_of_a_state, CReLU())
        size = 2 * embedding_units
    elif image := image_shape(observation_space):
        embedding, size = residual_embedding(image, view, embedding_units, blocks, generator), embedding_units
    elif isinstance(observation_space, spaces.Box) and len(observation_space.shape) == 1:
        embedding, size = nn.Sequential(view), observation_space.shape[0]
    else:
        raise ValueError(f"observation_space is {observation_space}; it must be {GRIDS}, {IMAGES}, or a flat Box.")
    return ReachabilityNetwork(
        embedding,
        size,
        layers=layers,
        units=units,
        pair_input=pair_input,
        generator=generator,
        at_once=IMAGES_AT_ONCE if image_shape(observation_space) else None,
    )
