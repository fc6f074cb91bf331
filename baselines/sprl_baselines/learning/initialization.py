"""Layers with orthogonal weights and zero biases, drawn from a generator that is passed in."""

from __future__ import annotations

from math import sqrt

import torch
from torch import nn
from torch.nn.utils import skip_init

POLICY_GAIN, VALUE_GAIN = 0.01, 1.0
# The published code uses sqrt(2) before plain ReLUs. Before CReLUs, which give twice the features, exploration ends in
# the first updates with sqrt(2) and Table 1's learning rate, but not with 1 (`notes/grid-network.md`).
RELU_GAIN, CRELU_GAIN = sqrt(2), 1.0


def linear(inputs: int, outputs: int, gain: float, generator: torch.Generator) -> nn.Linear:
    """Return a linear layer with orthogonal weights and zero biases."""
    layer: nn.Linear = skip_init(nn.Linear, inputs, outputs)  # type: ignore[no-untyped-call] # torch has no types there
    nn.init.orthogonal_(layer.weight, gain, generator)
    nn.init.zeros_(layer.bias)
    return layer


def convolution(
    inputs: int, outputs: int, side: int, stride: int, generator: torch.Generator, *, padding: int = 0
) -> nn.Conv2d:
    """Return a convolution with orthogonal weights, for a ReLU behind it, and zero biases."""
    layer: nn.Conv2d = skip_init(  # type: ignore[no-untyped-call] # torch has no types there
        nn.Conv2d, inputs, outputs, side, stride=stride, padding=padding
    )
    nn.init.orthogonal_(layer.weight, RELU_GAIN, generator)
    assert layer.bias is not None
    nn.init.zeros_(layer.bias)
    return layer
