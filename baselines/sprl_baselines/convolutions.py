"""The convolutions of the grid network (appendix D.3), compiled for the CPU and as PyTorch has them elsewhere.

Each layer is a 2x2 SAME convolution y and its concatenated rectifier, relu(y, -y); SAME for a 2x2 kernel pads at the
bottom and on the right only. On images as small as these PyTorch spends more time around the products than on them, so
they are spelled out here. A block of images is laid out as one plane a channel, each image with an empty row below and
an empty column on its right: then each of a kernel's four taps is the whole plane moved by a constant, and the inner
loops run over long rows. Backward, the block is computed again, which is cheaper than to remember it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Any, Final, TypeVar, cast

import numpy as np
import torch
from numba import njit
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.autograd.function import once_differentiable
from torch.nn import functional

__all__ = ["CReLUConvolutions"]

Array = NDArray[np.float32]
Arrays = tuple[Array, ...]
Places = NDArray[np.int64]
Number = np.float32
Function = TypeVar("Function", bound=Callable[..., Any])

BLOCK: Final = 1024  # numbers in a plane, so that the planes that are worked on stay in the cache
FAST_MATH: Final = {"contract", "nsz", "reassoc"}  # sums may be taken in any order, the same one every time


class CReLUConvolutions(nn.Module):
    """2x2 SAME convolutions, each followed by its concatenated rectifier.

    Args:
        inputs: Channels C of an image.
        outputs: Channels O of each convolution, half of those that its rectifier gives.
        gain: Of the orthogonal weights.
        generator: Source of the weights, on the CPU.
    """

    def __init__(self, inputs: int, outputs: Sequence[int], gain: float, generator: torch.Generator) -> None:
        super().__init__()
        channels = [inputs, *(2 * count for count in outputs)]
        shapes = [(after // 2, before, 2, 2) for before, after in pairwise(channels)]
        self.weights = nn.ParameterList(nn.Parameter(torch.empty(shape)) for shape in shapes)
        self.biases = nn.ParameterList(nn.Parameter(torch.zeros(shape[0])) for shape in shapes)
        for weight in self.weights:
            nn.init.orthogonal_(weight, gain, generator)

    def forward(self, images: Tensor) -> Tensor:
        """Images `[B, C, H, W]` -> features `[B, H * W * 2 O]`, cell by cell."""
        compiled = images.device.type == "cpu" and images.dtype == torch.float32 and not images.requires_grad
        return (self._compiled(images) if compiled else self._plain(images)).flatten(1)

    def _compiled(self, images: Tensor) -> Tensor:
        cells = images.permute(0, 2, 3, 1)
        features: Tensor = _Compiled.apply(cells, len(self.weights), *self.weights, *self.biases)  # type: ignore[no-untyped-call]
        return features

    def _plain(self, images: Tensor) -> Tensor:
        for weight, bias in zip(self.weights, self.biases, strict=True):
            responses = functional.conv2d(functional.pad(images, (0, 1, 0, 1)), weight, bias)
            images = functional.relu(torch.cat((responses, -responses), dim=1))
        return images.permute(0, 2, 3, 1)


class _Compiled(torch.autograd.Function):
    """The compiled functions below, as PyTorch calls them. The images get no gradient."""

    @staticmethod
    def forward(ctx: Any, images: Tensor, layers: int, *parameters: Tensor) -> Tensor:
        ctx.save_for_backward(images, *parameters)
        ctx.layers = layers
        weights, biases = _arrays(parameters[:layers]), _arrays(parameters[layers:])
        features = np.empty((*images.shape[:3], 2 * len(biases[-1])), np.float32)
        _forward(_array(images), weights, biases, features)
        return torch.from_numpy(features)

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor | None, ...]:
        images, *parameters = ctx.saved_tensors
        weights, biases = _arrays(parameters[: ctx.layers]), _arrays(parameters[ctx.layers :])
        to_weights = tuple(np.zeros_like(weight) for weight in weights)
        to_biases = tuple(np.zeros_like(bias) for bias in biases)
        _backward(_array(images), weights, biases, _array(gradient), to_weights, to_biases)
        gradients = [torch.from_numpy(array) for array in (*to_weights, *to_biases)]
        shaped = [gradient.view_as(parameter) for gradient, parameter in zip(gradients, parameters, strict=True)]
        return (None, None, *shaped)


def _array(tensor: Tensor) -> Array:
    return tensor.detach().contiguous().numpy()


def _arrays(tensors: Sequence[Tensor]) -> Arrays:
    """Return weights `[O, C, 2, 2]` as `[O, C, 4]`, and biases as they are."""
    return tuple(_array(tensor if tensor.ndim == 1 else tensor.flatten(2)) for tensor in tensors)


def _compiled(function: Function) -> Function:
    """Compile to machine code, cached on disk, or not at all where no folder can be written."""
    try:
        return cast(Function, njit(cache=True, nogil=True, error_model="numpy", fastmath=FAST_MATH)(function))
    except RuntimeError:
        return cast(Function, njit(nogil=True, error_model="numpy", fastmath=FAST_MATH)(function))


# A plane holds `count` numbers, (H + 1) * (W + 1) an image, and `stride` = W + 1 lie between one row and the next.
# Behind a plane that is convolved, and before a gradient that is, lie stride + 1 numbers more, for the taps to reach.


@_compiled
def _forward(images: Array, weights: Arrays, biases: Arrays, features: Array) -> None:
    """Fill `features` [B, H, W, 2 O] from `images` [B, H, W, C]."""
    rows, inside = _rows(weights), _inside(images.shape)
    planes = _planes(rows, inside)
    for first in range(0, len(images), len(inside)):
        block = images[first : first + len(inside)]
        _rectified(block, weights, biases, rows, inside, planes)
        _unpack(planes[rows[-2] : rows[-1]], features[first : first + len(inside)])


@_compiled
def _backward(
    images: Array, weights: Arrays, biases: Arrays, gradient: Array, to_weights: Arrays, to_biases: Arrays
) -> None:
    """Add the gradients of the parameters, from that of the features."""
    rows, inside = _rows(weights), _inside(images.shape)
    planes, to_planes = _planes(rows, inside), _planes(rows, inside)
    stride = inside.shape[2]
    for first in range(0, len(images), len(inside)):
        block = images[first : first + len(inside)]
        count = inside[: len(block)].size
        _rectified(block, weights, biases, rows, inside, planes)
        _pack(gradient[first : first + len(inside)], to_planes[rows[-2] : rows[-1]])
        for layer in range(len(weights) - 1, -1, -1):
            before, after, behind = rows[layer], rows[layer + 1], rows[layer + 2]
            to_responses = np.zeros((len(biases[layer]), stride + 1 + count), np.float32)
            _unrectify(planes[after:behind], to_planes[after:behind], count, stride, to_responses)
            _correlate_gradient(planes[before:after], to_responses, count, stride, to_weights[layer], to_biases[layer])
            if layer:
                to_planes[before:after] = 0
                _correlate(to_responses, _turned(weights[layer]), count, stride, to_planes[before:after])


@_compiled
def _rows(weights: Arrays) -> Places:
    """Return where the planes of the images begin, those of each layer, and where the last ones end."""
    rows = np.zeros(len(weights) + 2, np.int64)
    rows[1] = weights[0].shape[1]
    for layer in range(len(weights)):
        rows[layer + 2] = rows[layer + 1] + 2 * len(weights[layer])
    return rows


@_compiled
def _inside(shape: tuple[int, int, int, int]) -> Array:
    """Return 1 where the planes of a block `[B, H + 1, W + 1]` hold a cell, and 0 where they pad."""
    number, height, width, _ = shape
    number = max(1, min(number, BLOCK // ((height + 1) * (width + 1))))
    inside = np.zeros((number, height + 1, width + 1), np.float32)
    inside[:, :height, :width] = 1
    return inside


@_compiled
def _planes(rows: Places, inside: Array) -> Array:
    """Return room for the planes of a block, those of the images and of every layer."""
    return np.zeros((rows[-1], inside.size + inside.shape[2] + 1), np.float32)


@_compiled
def _turned(weights: Array) -> Array:
    """Return the weights `[C, O, 4]` by which gradients go back: the same taps, the other way round."""
    outputs, channels, taps = weights.shape
    turned = np.empty((channels, outputs, taps), np.float32)
    for output in range(outputs):
        for channel in range(channels):
            for tap in range(taps):
                turned[channel, output, taps - 1 - tap] = weights[output, channel, tap]
    return turned


@_compiled
def _rectified(images: Array, weights: Arrays, biases: Arrays, rows: Places, inside: Array, planes: Array) -> None:
    """Fill the planes with a block of images and with what each layer makes of them."""
    stride, count = inside.shape[2], inside[: len(images)].size
    _pack(images, planes[: rows[1]])
    for layer in range(len(weights)):
        before, after = planes[rows[layer] : rows[layer + 1]], planes[rows[layer + 1] : rows[layer + 2]]
        for output in range(len(biases[layer])):
            after[output, :count] = biases[layer][output]
        _correlate(before, weights[layer], count, stride, after)
        _rectify(after, count, inside.reshape(-1))


@_compiled
def _correlate(planes: Array, weights: Array, count: int, stride: int, out: Array) -> None:
    """Add to each of the first planes of `out` the four taps of all `planes`."""
    for output in range(weights.shape[0]):
        row = out[output, :count]
        for channel in range(weights.shape[1]):
            plane, taps = planes[channel], weights[output, channel]
            here, right = plane[:count], plane[1 : count + 1]
            below, diagonal = plane[stride : count + stride], plane[stride + 1 : count + stride + 1]
            first, second, third, fourth = taps[0], taps[1], taps[2], taps[3]
            for place in range(count):
                row[place] += (
                    first * here[place] + second * right[place] + third * below[place] + fourth * diagonal[place]
                )


@_compiled
def _correlate_gradient(
    planes: Array, gradient: Array, count: int, stride: int, to_weights: Array, to_biases: Array
) -> None:
    """Add the gradients of weights and bias, from that of the responses; two outputs at a time share what is read."""
    outputs, channels, _ = to_weights.shape
    for output in range(outputs):
        to_biases[output] += gradient[output, stride + 1 :][:count].sum()
    for output in range(0, outputs, 2):
        other = min(output + 1, outputs - 1)
        error, error_too = gradient[output, stride + 1 :][:count], gradient[other, stride + 1 :][:count]
        for channel in range(channels):
            plane = planes[channel]
            here, right = plane[:count], plane[1 : count + 1]
            below, diagonal = plane[stride : count + stride], plane[stride + 1 : count + stride + 1]
            first = second = third = fourth = np.float32(0)
            first_too = second_too = third_too = fourth_too = np.float32(0)
            for place in range(count):
                one, two = error[place], error_too[place]
                first += one * here[place]
                second += one * right[place]
                third += one * below[place]
                fourth += one * diagonal[place]
                first_too += two * here[place]
                second_too += two * right[place]
                third_too += two * below[place]
                fourth_too += two * diagonal[place]
            _add_taps(to_weights[output, channel], first, second, third, fourth)
            if other != output:
                _add_taps(to_weights[other, channel], first_too, second_too, third_too, fourth_too)


@_compiled
def _add_taps(taps: Array, first: Number, second: Number, third: Number, fourth: Number) -> None:
    taps[0] += first
    taps[1] += second
    taps[2] += third
    taps[3] += fourth


@_compiled
def _rectify(planes: Array, count: int, inside: Array) -> None:
    """Turn responses, in the first half of the planes, into both of their rectified signs, and 0 where planes pad."""
    half = len(planes) // 2
    for channel in range(half):
        positive, negative = planes[channel], planes[half + channel]
        for place in range(count):
            response = positive[place] * inside[place]
            positive[place] = max(response, np.float32(0))
            negative[place] = max(-response, np.float32(0))


@_compiled
def _unrectify(planes: Array, gradient: Array, count: int, stride: int, out: Array) -> None:
    """Fill `out` with the gradient of the responses, from that of both rectified signs."""
    half = len(planes) // 2
    zero = np.float32(0)
    for channel in range(half):
        positive, negative = planes[channel], planes[half + channel]
        up, down, row = gradient[channel], gradient[half + channel], out[channel][stride + 1 :]
        for place in range(count):
            row[place] = (up[place] if positive[place] > 0 else zero) - (down[place] if negative[place] > 0 else zero)


@_compiled
def _pack(images: Array, planes: Array) -> None:
    """Lay out images `[B, H, W, C]` as planes."""
    number, height, width, channels = images.shape
    for channel in range(channels):
        grids = planes[channel, : number * (height + 1) * (width + 1)].reshape(number, height + 1, width + 1)
        for image in range(number):
            for y in range(height):
                for x in range(width):
                    grids[image, y, x] = images[image, y, x, channel]


@_compiled
def _unpack(planes: Array, images: Array) -> None:
    """Take images `[B, H, W, C]` from planes."""
    number, height, width, channels = images.shape
    for channel in range(channels):
        grids = planes[channel, : number * (height + 1) * (width + 1)].reshape(number, height + 1, width + 1)
        for image in range(number):
            for y in range(height):
                for x in range(width):
                    images[image, y, x, channel] = grids[image, y, x]
