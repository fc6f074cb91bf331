"""The convolutions of the grid network (appendix D.3), compiled for the CPU and as PyTorch has them elsewhere.

Each layer is a 2x2 SAME convolution y and its concatenated rectifier, relu(y, -y); SAME for a 2x2 kernel pads at the
bottom and on the right only.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn
from torch.autograd.function import once_differentiable
from torch.nn import functional

from sprl_baselines.kernels import convolution_loops
from sprl_baselines.kernels.compiling import Array, Arrays
from sprl_baselines.kernels.convolution_layout import Layout, layout, tiles_back
from sprl_baselines.kernels.vectors import LANES


class CReLUConvolutions(nn.Module):
    """2x2 SAME convolutions, each followed by its concatenated rectifier.

    Args:
        inputs: Channels C of an image.
        outputs: Channels of each convolution, at least one of them; its rectifier gives twice as many.
        gain: Of the orthogonal weights.
        generator: Source of the weights, on the CPU.
    """

    def __init__(self, inputs: int, outputs: Sequence[int], gain: float, generator: torch.Generator) -> None:
        super().__init__()
        self.outputs = tuple(outputs)
        channels = [inputs, *(2 * count for count in outputs)]
        shapes = [(after // 2, before, 2, 2) for before, after in pairwise(channels)]
        self.weights = nn.ParameterList(nn.Parameter(torch.empty(shape)) for shape in shapes)
        self.biases = nn.ParameterList(nn.Parameter(torch.zeros(shape[0])) for shape in shapes)
        for weight in self.weights:
            nn.init.orthogonal_(weight, gain, generator)

    def forward(self, images: Tensor) -> Tensor:
        """Images `[B, C, H, W]` -> features `[B, H * W * 2 O]`, cell by cell; O are the last layer's outputs.

        Raises:
            ValueError: The images have another number of channels.
        """
        self.check(images)
        return (self._compiled(images) if self._can_compile(images) else self._plain(images)).flatten(1)

    def check(self, images: Tensor) -> None:
        """Refuse images with another number of channels."""
        if images.shape[1] != self.weights[0].shape[1]:
            raise ValueError(f"Channels of images is {images.shape[1]}; it must be {self.weights[0].shape[1]}.")

    def layout(self) -> Layout:
        """Return a copy of the parameters, as the compiled functions take them."""
        return layout(*_arrays((*self.weights, *self.biases)))

    def _can_compile(self, images: Tensor) -> bool:
        fit = all(one.device.type == "cpu" and one.dtype == torch.float32 for one in (images, self.weights[0]))
        return fit and not images.requires_grad

    def _compiled(self, images: Tensor) -> Tensor:
        cells, parameters = images.permute(0, 2, 3, 1), (*self.weights, *self.biases)
        if not torch.is_grad_enabled():
            return _features(cells, self.layout())
        features: Tensor = _Compiled.apply(cells, *parameters)  # type: ignore[no-untyped-call] # torch has no types there
        return features

    def _plain(self, images: Tensor) -> Tensor:
        for weight, bias in zip(self.weights, self.biases, strict=True):
            responses = functional.conv2d(functional.pad(images, (0, 1, 0, 1)), weight, bias)
            images = functional.relu(torch.cat((responses, -responses), dim=1))
        return images.permute(0, 2, 3, 1)


class _Compiled(torch.autograd.Function):
    """The compiled functions, as PyTorch calls them. The images get no gradient."""

    @staticmethod
    def forward(ctx: Any, images: Tensor, *parameters: Tensor) -> Tensor:
        """Images `[B, H, W, C]`, then every layer's weights, then their biases -> features `[B, H, W, 2 O]`."""
        ctx.save_for_backward(images, *parameters)
        ctx.layout = layout(*_arrays(parameters))
        return _features(images, ctx.layout)

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor | None, ...]:
        """From the gradient of the features, those of the parameters, in their order and shapes."""
        images, *parameters = ctx.saved_tensors
        weights, biases = _arrays(parameters)
        sums = np.zeros((len(weights), LANES * max(weight.size for weight in weights)), np.float32)
        bias_sums = np.zeros((len(biases), LANES * max(map(len, biases))), np.float32)
        laid: Layout = ctx.layout
        back = tiles_back(weights)
        convolution_loops.backward(_array(images), *laid, back, _array(gradient), sums, bias_sums)
        rows = (*zip(sums, weights, strict=True), *zip(bias_sums, biases, strict=True))
        ones = np.ones(LANES, np.float32)
        found = [row[: LANES * array.size].reshape(-1, LANES) @ ones for row, array in rows]
        shaped = [torch.from_numpy(one).view_as(like) for one, like in zip(found, parameters, strict=True)]
        return (None, *shaped)


def _array(tensor: Tensor) -> Array:
    return tensor.detach().contiguous().numpy()


def _features(images: Tensor, laid: Layout) -> Tensor:
    """Images `[B, H, W, C]` -> features `[B, H, W, 2 O]`."""
    channels = int(laid.offsets[-1] - laid.offsets[-2])
    features = np.empty((*images.shape[:3], channels), np.float32)
    convolution_loops.forward(_array(images), *laid, features)
    return torch.from_numpy(features)


def _arrays(parameters: Sequence[Tensor]) -> tuple[Arrays, Arrays]:
    """Return the weights, each `[O, C, 2, 2]` as `[O, C, 4]`, and the biases, each `[O]`."""
    layers = len(parameters) // 2
    weights = tuple(_array(weight.flatten(2)) for weight in parameters[:layers])
    return weights, tuple(_array(bias) for bias in parameters[layers:])
