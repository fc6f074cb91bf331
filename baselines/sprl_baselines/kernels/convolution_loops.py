"""2x2 SAME convolutions with concatenated rectifiers, compiled for the CPU: forward, and backward to the parameters.

On images as small as a grid PyTorch spends more time around the products than on them, so they are spelled out here.
Eight images are computed at a time, one in each lane of a vector: what is done to a cell is one instruction for all
eight, and lanes without an image hold zeros. Backward, the block is computed again: that stays in the processor's
cache, and what the forward pass could have kept does not.

A channel of a block is a plane `[H + 1, W + 1, 8]` with an empty row below and an empty column on the right, so that
each of a kernel's four taps is the plane moved by a constant. In front of it lies an empty row and cell more, as
gradients move the other way. The planes of the images, then those of each layer, are one flat array.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from sprl_baselines.kernels.compiling import Array, Offsets, kernel
from sprl_baselines.kernels.convolution_layout import TILE
from sprl_baselines.kernels.vectors import (
    LANES,
    add,
    load,
    multiply_add,
    negated,
    rectified,
    spread,
    store,
    subtract,
    transpose,
    where_positive,
)

BLOCK: Final = LANES  # images at a time
TAPS: Final = 4

Sides = tuple[int, int]  # height and width of an image


@kernel
def forward(images: Array, offsets: Offsets, tiles: Array, starts: Array, features: Array) -> None:
    """Fill `features` [B, H, W, 2 O] from `images` [B, H, W, C]; the rest is a `convolution_layout.Layout`."""
    plane = plane_size(images.shape[1:3])
    planes = np.zeros(offsets[-1] * plane, np.float32)
    for first in range(0, len(images), BLOCK):
        _fill(images[first : first + BLOCK], offsets, tiles, starts, planes)
        _unpack(planes[offsets[-2] * plane :], features[first : first + BLOCK])


@kernel
def backward(
    images: Array,
    offsets: Offsets,
    tiles: Array,
    starts: Array,
    tiles_back: Array,
    gradient: Array,
    sums: Array,
    bias_sums: Array,
) -> None:
    """Add the gradients of the parameters, from that of the features.

    Args:
        images: `[B, H, W, C]`.
        offsets: Of the layout, as the next two.
        tiles: The weights.
        starts: The biases.
        tiles_back: The weights for the way back.
        gradient: Of the features, `[B, H, W, 2 O]`.
        sums: A row for each layer, with the gradients of its weights `[O, C, 4, 8]`, in eight summands each.
        bias_sums: A row for each layer, with the gradients of its biases `[O, 8]`.
    """
    sides, plane = images.shape[1:3], plane_size(images.shape[1:3])
    planes, gradients = np.zeros(offsets[-1] * plane, np.float32), np.zeros(offsets[-1] * plane, np.float32)
    errors, nothing = np.zeros(offsets[-1] * plane, np.float32), np.zeros(offsets[-1] + TILE, np.float32)
    for first in range(0, len(images), BLOCK):
        _fill(images[first : first + BLOCK], offsets, tiles, starts, planes)
        _pack(gradient[first : first + BLOCK], gradients[offsets[-2] * plane :])
        for layer in range(len(tiles) - 1, -1, -1):
            before, after = offsets[layer] * plane, offsets[layer + 1] * plane
            channels, outputs = _channels(offsets, layer)
            _rectify_gradient(planes[after:], gradients[after:], outputs, sides, errors)
            _correlate_gradient(planes[before:], errors, outputs, channels, sides, sums[layer])
            _add_planes(errors, outputs, plane, bias_sums[layer])
            if layer:
                _correlate(errors, outputs, -1, tiles_back[layer], nothing, sides, gradients[before:], channels, False)


@kernel
def _channels(offsets: Offsets, layer: int) -> tuple[int, int]:
    """Return the channels that go into a layer, and its outputs, each of which has two rectified signs."""
    return offsets[layer + 1] - offsets[layer], (offsets[layer + 2] - offsets[layer + 1]) // 2


@kernel
def plane_size(sides: Sides) -> int:
    """Return the numbers in a plane: an odd number of cells, so that planes do not fight for places in the cache."""
    return (_cell(sides[0] + 1, 0, sides[1]) // LANES | 1) * LANES


@kernel
def _cell(y: int, x: int, width: int) -> int:
    """Return where a cell's eight numbers begin in a plane."""
    return (width + 2 + y * (width + 1) + x) * LANES


@kernel
def _fill(images: Array, offsets: Offsets, tiles: Array, starts: Array, planes: Array) -> None:
    """Fill the planes with a block of images and with what each layer makes of them."""
    sides, plane = images.shape[1:3], plane_size(images.shape[1:3])
    _pack(images, planes)
    for layer in range(len(tiles)):
        before, after = planes[offsets[layer] * plane :], planes[offsets[layer + 1] * plane :]
        channels, outputs = _channels(offsets, layer)
        _correlate(before, channels, 1, tiles[layer], starts[layer], sides, after, outputs, True)


@kernel
def _correlate(
    planes: Array,
    channels: int,
    sign: int,
    weights: Array,
    biases: Array,
    sides: Sides,
    out: Array,
    outputs: int,
    rectify: bool,
) -> None:
    """Fill planes with biases and the taps of `channels` planes: below and on the right, or above and on the left.

    Args:
        planes: What is correlated.
        channels: Their number.
        sign: 1 for taps below and on the right, -1 for taps above and on the left.
        weights: Of one layer, as a layout has them.
        biases: One for each output of whole tiles.
        sides: Of an image.
        out: A plane for each output, or two: rectified, and negated and rectified.
        outputs: Their number.
        rectify: Whether there are two.
    """
    height, width = sides
    plane = plane_size(sides)
    right, below, diagonal = sign * LANES, sign * (width + 1) * LANES, sign * (width + 2) * LANES
    other = outputs * plane
    for output in range(0, outputs, TILE):
        left = outputs - output
        for cell in range(height * width):
            place = _cell(cell // width, cell % width, width)
            to = output * plane + place
            weight = output * channels * TAPS
            sum0, sum1 = spread(biases, output), spread(biases, output + 1)
            sum2, sum3 = spread(biases, output + 2), spread(biases, output + 3)
            sum4, sum5 = spread(biases, output + 4), spread(biases, output + 5)
            sum6, sum7 = spread(biases, output + 6), spread(biases, output + 7)
            for _ in range(channels):
                for tap in (0, right, below, diagonal):
                    cells = load(planes, place + tap)
                    sum0 = multiply_add(cells, spread(weights, weight), sum0)
                    sum1 = multiply_add(cells, spread(weights, weight + 1), sum1)
                    sum2 = multiply_add(cells, spread(weights, weight + 2), sum2)
                    sum3 = multiply_add(cells, spread(weights, weight + 3), sum3)
                    sum4 = multiply_add(cells, spread(weights, weight + 4), sum4)
                    sum5 = multiply_add(cells, spread(weights, weight + 5), sum5)
                    sum6 = multiply_add(cells, spread(weights, weight + 6), sum6)
                    sum7 = multiply_add(cells, spread(weights, weight + 7), sum7)
                    weight += TILE
                place += plane
            _put(sum0, out, to, other, rectify)
            if left > 1:
                _put(sum1, out, to + plane, other, rectify)
            if left > 2:
                _put(sum2, out, to + 2 * plane, other, rectify)
            if left > 3:
                _put(sum3, out, to + 3 * plane, other, rectify)
            if left > 4:
                _put(sum4, out, to + 4 * plane, other, rectify)
            if left > 5:
                _put(sum5, out, to + 5 * plane, other, rectify)
            if left > 6:
                _put(sum6, out, to + 6 * plane, other, rectify)
            if left > 7:
                _put(sum7, out, to + 7 * plane, other, rectify)


@kernel
def _put(value: Any, out: Array, place: int, other: int, rectify: bool) -> None:
    """Write a vector, or both of its rectified signs, the second `other` numbers behind the first."""
    if rectify:
        store(out, place, rectified(value))
        store(out, place + other, rectified(negated(value)))
    else:
        store(out, place, value)


@kernel
def _correlate_gradient(planes: Array, errors: Array, outputs: int, channels: int, sides: Sides, sums: Array) -> None:
    """Add the gradients of the weights, `[O, C, 4, 8]` by lanes, from that of the responses.

    Two outputs at a time share what is read of the planes; where their number is odd, the last one's partner is waste.
    """
    height, width = sides
    plane = plane_size(sides)
    right, below, diagonal = LANES, (width + 1) * LANES, (width + 2) * LANES
    for channel in range(channels):
        for output in range(0, outputs, 2):
            other = min(output + 1, outputs - 1)
            to, to_other = (output * channels + channel) * TAPS * LANES, (other * channels + channel) * TAPS * LANES
            first, first_other = load(sums, to), load(sums, to_other)
            second, second_other = load(sums, to + LANES), load(sums, to_other + LANES)
            third, third_other = load(sums, to + 2 * LANES), load(sums, to_other + 2 * LANES)
            fourth, fourth_other = load(sums, to + 3 * LANES), load(sums, to_other + 3 * LANES)
            for y in range(height):
                place = _cell(y, 0, width)
                for _ in range(width):
                    here = channel * plane + place
                    error, error_other = load(errors, output * plane + place), load(errors, other * plane + place)
                    cells = load(planes, here)
                    first = multiply_add(cells, error, first)
                    first_other = multiply_add(cells, error_other, first_other)
                    cells = load(planes, here + right)
                    second = multiply_add(cells, error, second)
                    second_other = multiply_add(cells, error_other, second_other)
                    cells = load(planes, here + below)
                    third = multiply_add(cells, error, third)
                    third_other = multiply_add(cells, error_other, third_other)
                    cells = load(planes, here + diagonal)
                    fourth = multiply_add(cells, error, fourth)
                    fourth_other = multiply_add(cells, error_other, fourth_other)
                    place += LANES
            if other != output:
                _put_taps(first_other, second_other, third_other, fourth_other, sums, to_other)
            _put_taps(first, second, third, fourth, sums, to)


@kernel
def _put_taps(first: Any, second: Any, third: Any, fourth: Any, sums: Array, place: int) -> None:
    store(sums, place, first)
    store(sums, place + LANES, second)
    store(sums, place + 2 * LANES, third)
    store(sums, place + 3 * LANES, fourth)


@kernel
def _add_planes(errors: Array, outputs: int, plane: int, sums: Array) -> None:
    """Add the gradients of the biases, `[O, 8]` by lanes, from that of the responses."""
    for output in range(outputs):
        total = load(sums, output * LANES)
        for place in range(output * plane, (output + 1) * plane, LANES):
            total = add(total, load(errors, place))
        store(sums, output * LANES, total)


@kernel
def _rectify_gradient(planes: Array, gradients: Array, outputs: int, sides: Sides, errors: Array) -> None:
    """Fill `errors` with the gradient of the responses, from that of both rectified signs."""
    height, width = sides
    plane = plane_size(sides)
    for output in range(outputs):
        for y in range(height):
            place = output * plane + _cell(y, 0, width)
            other = place + outputs * plane
            for _ in range(width):
                up = where_positive(load(planes, place), load(gradients, place))
                down = where_positive(load(planes, other), load(gradients, other))
                store(errors, place, subtract(up, down))
                place += LANES
                other += LANES


@kernel
def _pack(images: Array, planes: Array) -> None:
    """Lay out at most eight images `[B, H, W, C]` as planes."""
    count, height, width, channels = images.shape
    plane, flat, whole = plane_size((height, width)), images.reshape(-1), 0
    image = height * width * channels
    if count == BLOCK:
        whole = channels // LANES * LANES
    for cell in range(height * width):
        place = _cell(cell // width, cell % width, width)
        for channel in range(0, whole, LANES):
            transpose(flat, cell * channels + channel, image, planes, channel * plane + place, plane)
        for channel in range(whole, channels):
            for lane in range(count):
                planes[channel * plane + place + lane] = flat[lane * image + cell * channels + channel]
            planes[channel * plane + place + count : channel * plane + place + BLOCK] = 0


@kernel
def _unpack(planes: Array, images: Array) -> None:
    """Take at most eight images `[B, H, W, C]` from planes."""
    count, height, width, channels = images.shape
    plane, flat, whole = plane_size((height, width)), images.reshape(-1), 0
    image = height * width * channels
    if count == BLOCK:
        whole = channels // LANES * LANES
    for cell in range(height * width):
        place = _cell(cell // width, cell % width, width)
        for channel in range(0, whole, LANES):
            transpose(planes, channel * plane + place, plane, flat, cell * channels + channel, image)
        for channel in range(whole, channels):
            for lane in range(count):
                flat[lane * image + cell * channels + channel] = planes[channel * plane + place + lane]
