"""The network that judges pairs: what each state looks like alone, and a head over two of them.

Grids: the policy's three convolutions (appendix D.3) and a fully connected layer for each state, then a head; the paper
does not say what it used there. Flat observations: the head alone (appendix G.4). The head's first layer is linear, so
it is computed for each state rather than for each pair, and a pair is a sum.
"""

from __future__ import annotations

from itertools import pairwise
from math import prod
from typing import Any, NamedTuple

import numpy as np
import torch
from gymnasium import Space, spaces
from torch import Tensor, nn

from sprl_baselines.networks import HIDDEN_GAIN, VALUE_GAIN, ToFloat, grid_convolutions, linear

PAIR_INPUTS = ("pair", "difference")


class Projections(NamedTuple):
    """The head's first layer for B states, `[B, H]`: as the earlier of a pair, and as the later."""

    earlier: Tensor
    later: Tensor


class ReachabilityNetwork(nn.Module):
    """Says how likely it is that the first of two states leads to the second within k steps.

    Args:
        embedding: What turns B states into `[B, E]`.
        features: E.
        layers: Hidden layers of the head.
        units: Width H of each.
        pair_input: "pair" for both states; "difference" for the later one and its difference from the earlier
            (appendix F.4).
        generator: Source of the initial parameters, on the CPU.
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
    ) -> None:
        super().__init__()
        self.embedding = embedding
        self.first = linear(2 * features, units, HIDDEN_GAIN, generator)
        self.difference = pair_input == "difference"
        hidden = [
            module
            for fan_in, fan_out in pairwise([units] * layers)
            for module in (nn.BatchNorm1d(fan_in), nn.ReLU(), linear(fan_in, fan_out, HIDDEN_GAIN, generator))
        ]
        self.rest = nn.Sequential(*hidden, nn.BatchNorm1d(units), nn.ReLU(), linear(units, 1, VALUE_GAIN, generator))

    def project(self, states: Tensor) -> Projections:
        """Compute all that concerns one state alone."""
        features = self.embedding(states)
        one, other = self.first.weight.chunk(2, dim=1)
        if self.difference:  # first(later, later - earlier)
            return Projections(-features @ other.T, features @ (one + other).T + self.first.bias)
        return Projections(features @ one.T, features @ other.T + self.first.bias)

    def judge(self, earlier: Tensor, later: Tensor) -> Tensor:
        """Return logits `[P]` of P pairs, from the projections of their states, `[P, H]` each."""
        logits: Tensor = self.rest(earlier + later).squeeze(-1)
        return logits


def reachability_network(
    observation_space: Space[Any],
    generator: torch.Generator,
    *,
    grid_encoding: str,
    embedding_units: int,
    layers: int,
    units: int,
    pair_input: str,
) -> ReachabilityNetwork:
    """Return the network for observations of one sub-env: a grid's, or a flat `Box`.

    Raises:
        ValueError: There is no network for such observations.
    """
    match observation_space:
        case spaces.Box(shape=(height, width, 3), dtype=np.uint8):
            convolutions, features = grid_convolutions(height, width, grid_encoding, generator)
            dense = linear(features, embedding_units, HIDDEN_GAIN, generator)
            embedding = nn.Sequential(*convolutions, dense, nn.ReLU())
            size = embedding_units
        case spaces.Box(shape=(_,)):
            embedding, size = nn.Sequential(ToFloat()), prod(observation_space.shape)
        case _:
            raise ValueError(
                f"No reachability network for observations in {observation_space}: need (H, W, 3) uint8 or a flat Box."
            )
    return ReachabilityNetwork(embedding, size, layers=layers, units=units, pair_input=pair_input, generator=generator)
