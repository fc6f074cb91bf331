"""A network laid out to act on a few observations at a time, by the parameters that it had then."""

from __future__ import annotations

from collections.abc import Sequence
from math import prod

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional

from sprl_baselines.kernels import dense_loops
from sprl_baselines.kernels.compiling import Array, Arrays
from sprl_baselines.kernels.convolutions import CReLUConvolutions

ACTIVATIONS = {"relu": (dense_loops.RELU, 1), "crelu": (dense_loops.CRELU, 2)}  # and how many numbers a unit gives


class PackedMLP:
    """Linear layers, each followed by an activation, then heads that share the last one's features.

    It computes what the modules do, to rounding, in single precision on a CPU, and records no gradient: on a dozen rows
    two to three times as fast. It keeps the parameters that the layers have when it is made, so make one a rollout.

    Args:
        layers: Hidden layers, at least one.
        heads: Layers without an activation; their units are returned side by side.
        activation: Of the hidden layers, "relu" or "crelu", the rectifier of both signs.
    """

    def __init__(self, layers: Sequence[nn.Linear], heads: Sequence[nn.Linear], activation: str = "relu") -> None:
        self._layers, self._heads = list(layers), list(heads)
        self._activation, self._signs = ACTIVATIONS[activation]
        self._units = sum(head.out_features for head in heads)
        self._weights, self._biases = self._packed()

    def __call__(self, rows: Tensor) -> Tensor:
        """Rows `[N, D]` -> all heads' units `[N, U]`.

        Raises:
            ValueError: The rows have another width than the first layer takes.
        """
        self._check(rows.shape[1])
        out = np.empty((len(rows), self._units), np.float32)
        dense_loops.dense(_array(rows), self._weights, self._biases, self._activation, out)
        return torch.from_numpy(out)

    def _check(self, features: int) -> None:
        if features != self._layers[0].in_features:
            raise ValueError(f"The rows have {features} features; they need {self._layers[0].in_features}.")

    def _packed(self) -> tuple[Arrays, Arrays]:
        """Return each layer's weights and biases as `dense_loops` takes them."""
        weights, biases, signs, width = [], [], 1, self._layers[0].in_features
        for weight, bias in self._matrices():
            weights.append(_panels(weight, signs, width))
            biases.append(functional.pad(bias, (0, -len(bias) % dense_loops.UNITS)).numpy())
            signs, width = self._signs, len(biases[-1])
        return tuple(weights), tuple(biases)

    def _matrices(self) -> list[tuple[Tensor, Tensor]]:
        """Return the weights `[U, D]` and biases `[U]` of the layers, and of all heads as one."""
        heads = torch.cat([head.weight.detach() for head in self._heads])
        head_biases = torch.cat([head.bias.detach() for head in self._heads])
        return [*((layer.weight.detach(), layer.bias.detach()) for layer in self._layers), (heads, head_biases)]


class PackedGridNetwork(PackedMLP):
    """The same behind convolutions.

    Args:
        convolutions: What comes before the first layer.
        layers: Hidden layers, at least one, each followed by both rectified signs.
        heads: Layers without an activation; their units are returned side by side.
    """

    def __init__(
        self, convolutions: CReLUConvolutions, layers: Sequence[nn.Linear], heads: Sequence[nn.Linear]
    ) -> None:
        super().__init__(layers, heads, "crelu")
        self._convolutions = convolutions
        self._layout = convolutions.layout()

    def __call__(self, images: Tensor) -> Tensor:
        """Images `[N, C, H, W]`, best with channels last in memory -> all heads' units `[N, U]`.

        Raises:
            ValueError: The images have another shape than the network takes.
        """
        self._convolutions.check(images)
        self._check(prod(images.shape[2:]) * 2 * self._convolutions.outputs[-1])
        out = np.empty((len(images), self._units), np.float32)
        cells = _array(images.permute(0, 2, 3, 1))
        dense_loops.convolved(cells, *self._layout, self._weights, self._biases, self._activation, out)
        return torch.from_numpy(out)


def _panels(weight: Tensor, signs: int, width: int) -> Array:
    """Return weights `[U, signs * D]`, filled up with zeros, as `[ceil(U / 16), signs * width, 16]`, flat."""
    more_inputs, more_units = width - weight.shape[1] // signs, -len(weight) % dense_loops.UNITS
    filled = functional.pad(weight.view(len(weight), signs, -1), (0, more_inputs, 0, 0, 0, more_units))
    return _array(filled.view(-1, dense_loops.UNITS, signs * width).transpose(1, 2)).reshape(-1)


def _array(tensor: Tensor) -> Array:
    return tensor.detach().contiguous().numpy()
