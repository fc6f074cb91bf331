"""2x2 SAME convolutions with CReLU, compiled for the CPU: forward, and backward to the parameters.

On images as small as a grid, most of PyTorch's time is overhead. Here a block of images is stored as one plane for each
channel; each image has an empty row below it and an empty column on its right. Then each of a kernel's four taps is
the whole plane shifted by a constant, and the inner loops run over long rows. The backward pass computes the block
again, because that is faster than storing it.

Everything is in one file, because Numba's cache on disk only notices changes of the file that holds a kernel.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final, TypeVar, cast

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float32]
Arrays = tuple[Array, ...]
Mask = NDArray[np.bool_]
Offsets = NDArray[np.int64]
F = TypeVar("F", bound=Callable[..., Any])

BLOCK: Final = 1024  # numbers in a plane, so that the planes in use stay in the CPU cache
FAST_MATH: Final = {"contract", "nsz", "reassoc"}  # sums may be reordered, but the order is the same every time


def kernel(function: F) -> F:
    """Compile to machine code, cached on disk if a folder is writable."""
    try:
        return cast(F, njit(cache=True, nogil=True, error_model="numpy", fastmath=FAST_MATH)(function))
    except RuntimeError:
        return cast(F, njit(nogil=True, error_model="numpy", fastmath=FAST_MATH)(function))


# A plane holds `count` numbers: (H + 1) * (W + 1) for each image, in rows of `stride` = W + 1. After the numbers of a
# plane, and before those of a gradient, there are stride + 1 more, because the taps read past the end. So planes are
# [C, count + stride + 1], with C = 2 O after a layer of O outputs, and weights are [O, C, 4].


@kernel
def forward(images: Array, weights: Arrays, biases: Arrays, features: Array) -> None:
    """Fill `features` [B, H, W, 2 O] from `images` [B, H, W, C]."""
    offsets, mask = _offsets(weights), _mask(images.shape)
    planes = _planes(offsets, mask)
    for first in range(0, len(images), len(mask)):
        block = images[first : first + len(mask)]
        _rectified(block, weights, biases, offsets, mask, planes)
        _unpack(planes[offsets[-2] : offsets[-1]], features[first : first + len(mask)])


@kernel
def backward(
    images: Array, weights: Arrays, biases: Arrays, gradient: Array, weight_gradients: Arrays, bias_gradients: Arrays
) -> None:
    """Add to the gradients of the parameters, from the gradient of the features."""
    offsets, mask = _offsets(weights), _mask(images.shape)
    planes, plane_gradients = _planes(offsets, mask), _planes(offsets, mask)
    stride = mask.shape[2]
    for first in range(0, len(images), len(mask)):
        block = images[first : first + len(mask)]
        count = mask[: len(block)].size
        _rectified(block, weights, biases, offsets, mask, planes)
        _pack(gradient[first : first + len(mask)], plane_gradients[offsets[-2] : offsets[-1]])
        for layer in range(len(weights) - 1, -1, -1):
            before, after, behind = offsets[layer], offsets[layer + 1], offsets[layer + 2]
            errors = np.zeros((len(biases[layer]), stride + 1 + count), np.float32)
            _rectify_gradient(planes[after:behind], plane_gradients[after:behind], count, stride, errors)
            _correlate_gradient(
                planes[before:after], errors, count, stride, weight_gradients[layer], bias_gradients[layer]
            )
            if layer:
                plane_gradients[before:after] = 0
                _correlate(errors, _flipped(weights[layer]), count, stride, plane_gradients[before:after])


@kernel
def _offsets(weights: Arrays) -> Offsets:
    """Return the first plane of the images, of each layer, and the end of the last layer's planes."""
    offsets = np.zeros(len(weights) + 2, np.int64)
    offsets[1] = weights[0].shape[1]
    for layer in range(len(weights)):
        offsets[layer + 2] = offsets[layer + 1] + 2 * len(weights[layer])
    return offsets


@kernel
def _mask(shape: tuple[int, int, int, int]) -> Mask:
    """Return which numbers of a block's planes `[B, H + 1, W + 1]` are cells and not padding."""
    number, height, width, _ = shape
    number = max(1, min(number, BLOCK // ((height + 1) * (width + 1))))
    mask = np.zeros((number, height + 1, width + 1), np.bool_)
    mask[:, :height, :width] = True
    return mask


@kernel
def _planes(offsets: Offsets, mask: Mask) -> Array:
    """Return zeros for the planes of a block: those of the images and of every layer."""
    return np.zeros((offsets[-1], mask.size + mask.shape[2] + 1), np.float32)


@kernel
def _flipped(weights: Array) -> Array:
    """Return the weights `[C, O, 4]` of the backward pass: the taps in reverse order."""
    outputs, channels, taps = weights.shape
    flipped = np.empty((channels, outputs, taps), np.float32)
    for output in range(outputs):
        for channel in range(channels):
            for tap in range(taps):
                flipped[channel, output, taps - 1 - tap] = weights[output, channel, tap]
    return flipped


@kernel
def _rectified(images: Array, weights: Arrays, biases: Arrays, offsets: Offsets, mask: Mask, planes: Array) -> None:
    """Fill the planes with a block of images and with the outputs of each layer."""
    stride, count = mask.shape[2], mask[: len(images)].size
    _pack(images, planes[: offsets[1]])
    for layer in range(len(weights)):
        before, after = planes[offsets[layer] : offsets[layer + 1]], planes[offsets[layer + 1] : offsets[layer + 2]]
        for output in range(len(biases[layer])):
            after[output, :count] = biases[layer][output]
        _correlate(before, weights[layer], count, stride, after)
        _rectify(after, count, mask.reshape(-1))


@kernel
def _correlate(planes: Array, weights: Array, count: int, stride: int, out: Array) -> None:
    """Add the four taps of all `planes` [C, ...] to the first planes of `out`, one for each of the weights' outputs.

    Two outputs at a time share the reads of the planes. If their number is odd, the last is paired with scratch space.
    """
    outputs, channels, _ = weights.shape
    waste = np.zeros(count, np.float32)
    for output in range(0, outputs, 2):
        other = min(output + 1, outputs - 1)
        row, row_2 = out[output, :count], out[other, :count] if other != output else waste
        for channel in range(channels):
            plane, taps, taps_2 = planes[channel], weights[output, channel], weights[other, channel]
            here, right = plane[:count], plane[1 : count + 1]
            below, diagonal = plane[stride : count + stride], plane[stride + 1 : count + stride + 1]
            first, second, third, fourth = taps[0], taps[1], taps[2], taps[3]
            first_2, second_2, third_2, fourth_2 = taps_2[0], taps_2[1], taps_2[2], taps_2[3]
            for place in range(count):
                one, two, three, four = here[place], right[place], below[place], diagonal[place]
                row[place] += first * one + second * two + third * three + fourth * four
                row_2[place] += first_2 * one + second_2 * two + third_2 * three + fourth_2 * four


@kernel
def _correlate_gradient(
    planes: Array, gradient: Array, count: int, stride: int, weight_gradients: Array, bias_gradients: Array
) -> None:
    """Add to the gradients of weights and biases, from the gradient `[O, stride + 1 + count]` of the responses.

    Two outputs at a time share the reads of the planes.
    """
    outputs, channels, _ = weight_gradients.shape
    for output in range(outputs):
        bias_gradients[output] += gradient[output, stride + 1 :][:count].sum()
    for output in range(0, outputs, 2):
        other = min(output + 1, outputs - 1)
        error, error_2 = gradient[output, stride + 1 :][:count], gradient[other, stride + 1 :][:count]
        for channel in range(channels):
            plane = planes[channel]
            here, right = plane[:count], plane[1 : count + 1]
            below, diagonal = plane[stride : count + stride], plane[stride + 1 : count + stride + 1]
            first = second = third = fourth = np.float32(0)
            first_2 = second_2 = third_2 = fourth_2 = np.float32(0)
            for place in range(count):
                one, two = error[place], error_2[place]
                first += one * here[place]
                second += one * right[place]
                third += one * below[place]
                fourth += one * diagonal[place]
                first_2 += two * here[place]
                second_2 += two * right[place]
                third_2 += two * below[place]
                fourth_2 += two * diagonal[place]
            _add_taps(weight_gradients[output, channel], first, second, third, fourth)
            if other != output:
                _add_taps(weight_gradients[other, channel], first_2, second_2, third_2, fourth_2)


@kernel
def _add_taps(taps: Array, first: np.float32, second: np.float32, third: np.float32, fourth: np.float32) -> None:
    taps[0] += first
    taps[1] += second
    taps[2] += third
    taps[3] += fourth


@kernel
def _rectify(planes: Array, count: int, mask: Mask) -> None:
    """Apply the CReLU to the responses in the first half of the planes; the padding becomes 0."""
    half, zero = len(planes) // 2, np.float32(0)
    for channel in range(half):
        positive, negative = planes[channel], planes[half + channel]
        for place in range(count):
            response = positive[place] if mask[place] else zero
            positive[place] = max(response, zero)
            negative[place] = max(-response, zero)


@kernel
def _rectify_gradient(planes: Array, gradient: Array, count: int, stride: int, out: Array) -> None:
    """Fill `out` with the gradient of the responses, from the gradient of the CReLU's outputs."""
    half, zero = len(planes) // 2, np.float32(0)
    for channel in range(half):
        positive, negative = planes[channel], planes[half + channel]
        up, down, row = gradient[channel], gradient[half + channel], out[channel][stride + 1 :]
        for place in range(count):
            row[place] = (up[place] if positive[place] > 0 else zero) - (down[place] if negative[place] > 0 else zero)


@kernel
def _pack(images: Array, planes: Array) -> None:
    """Copy images `[B, H, W, C]` into planes."""
    number, height, width, channels = images.shape
    for channel in range(channels):
        grids = planes[channel, : number * (height + 1) * (width + 1)].reshape(number, height + 1, width + 1)
        for image in range(number):
            for y in range(height):
                for x in range(width):
                    grids[image, y, x] = images[image, y, x, channel]


@kernel
def _unpack(planes: Array, images: Array) -> None:
    """Copy planes into images `[B, H, W, C]`."""
    number, height, width, channels = images.shape
    for channel in range(channels):
        grids = planes[channel, : number * (height + 1) * (width + 1)].reshape(number, height + 1, width + 1)
        for image in range(number):
            for y in range(height):
                for x in range(width):
                    images[image, y, x, channel] = grids[image, y, x]
