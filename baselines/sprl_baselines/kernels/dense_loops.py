"""Linear layers on a few rows, compiled for the CPU: what acting needs, step by step.

On a dozen rows a product is bound by how often the weights are read, and PyTorch by its calls. Here the sums of six
rows and sixteen units are in twelve registers: the units' weights are read in order, and each row's input is spread
over a register. Rows are laid out for that in blocks `[D, 8]`: six rows, and two places that are not used.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from sprl_baselines.kernels.compiling import Array, Arrays, Offsets, kernel
from sprl_baselines.kernels.convolution_loops import forward
from sprl_baselines.kernels.vectors import LANES, load, multiply_add, negated, rectified, spread, store, transpose

ROWS: Final = 6  # at a time
UNITS: Final = 2 * LANES  # at a time
PLAIN, RELU, CRELU = 0, 1, 2  # what follows a layer: nothing, a rectifier, or both rectified signs


@kernel
def dense(rows: Array, weights: Arrays, biases: Arrays, activation: int, out: Array) -> None:
    """Fill `out` [N, U] from `rows` [N, D] by layers, all but the last followed by the activation.

    Args:
        rows: Inputs of the first layer.
        weights: Each layer's, `[ceil(U / 16), D, 16]` in one dimension, where D are all numbers that the layer before
            gives, those of units that only fill it up too.
        biases: Each layer's, `[16 * ceil(U / 16)]`.
        activation: `RELU` or `CRELU`.
        out: Where the last layer's units go.
    """
    inputs = np.zeros(_room(len(rows)) * rows.shape[1], np.float32)
    inputs[: rows.size] = rows.reshape(-1)
    _layers(inputs, weights, biases, activation, out)


@kernel
def convolved(
    images: Array,
    offsets: Offsets,
    tiles: Array,
    starts: Array,
    weights: Arrays,
    biases: Arrays,
    activation: int,
    out: Array,
) -> None:
    """Fill `out` [N, U] from `images` [N, H, W, C] by `convolution_loops.forward`, and then layers."""
    count, height, width, _ = images.shape
    channels = offsets[-1] - offsets[-2]
    features = height * width * channels
    inputs = np.zeros(_room(count) * features, np.float32)
    forward(images, offsets, tiles, starts, inputs[: count * features].reshape(count, height, width, channels))
    _layers(inputs, weights, biases, activation, out)


@kernel
def _room(count: int) -> int:
    """Return the rows that the last block of `count` rows reaches over."""
    return (count + ROWS - 1) // ROWS * ROWS + LANES - ROWS


@kernel
def _layers(inputs: Array, weights: Arrays, biases: Arrays, activation: int, out: Array) -> None:
    """Fill `out` [N, U] from rows with room for the last block."""
    count, width, last = len(out), len(weights[0]) // len(biases[0]), len(weights) - 1
    for layer in range(len(weights)):
        follows = activation if layer < last else PLAIN
        units = len(biases[layer]) * (2 if follows == CRELU else 1)
        results = np.zeros(_room(count) * units, np.float32)
        _layer(_blocks(inputs, count, width), count, width, weights[layer], biases[layer], follows, results)
        inputs, width = results, units
    for row in range(count):
        for unit in range(out.shape[1]):
            out[row, unit] = inputs[row * width + unit]


@kernel
def _blocks(rows: Array, count: int, width: int) -> Array:
    """Return rows `[N, D]` as blocks `[ceil(N / 6), D, 8]`."""
    blocks, whole = np.empty((count + ROWS - 1) // ROWS * width * LANES, np.float32), width // LANES * LANES
    for first in range(0, count, ROWS):
        block = first // ROWS * width * LANES
        for place in range(0, whole, LANES):
            transpose(rows, first * width + place, width, blocks, block + place * LANES, LANES)
        for place in range(whole, width):
            for lane in range(LANES):
                blocks[block + place * LANES + lane] = rows[(first + lane) * width + place]
    return blocks


@kernel
def _layer(blocks: Array, count: int, width: int, weights: Array, biases: Array, follows: int, results: Array) -> None:
    """Fill rows of `results` from blocks of inputs."""
    units = len(biases) * (2 if follows == CRELU else 1)
    for unit in range(0, len(biases), UNITS):
        bias, bias_2 = load(biases, unit), load(biases, unit + LANES)
        for first in range(0, count, ROWS):
            row0, row1, row2, row3, row4, row5 = bias, bias, bias, bias, bias, bias
            row0_2, row1_2, row2_2, row3_2, row4_2, row5_2 = bias_2, bias_2, bias_2, bias_2, bias_2, bias_2
            here, place = first // ROWS * width * LANES, unit * width
            for _ in range(width):
                weight, weight_2 = load(weights, place), load(weights, place + LANES)
                one = spread(blocks, here)
                row0, row0_2 = multiply_add(one, weight, row0), multiply_add(one, weight_2, row0_2)
                one = spread(blocks, here + 1)
                row1, row1_2 = multiply_add(one, weight, row1), multiply_add(one, weight_2, row1_2)
                one = spread(blocks, here + 2)
                row2, row2_2 = multiply_add(one, weight, row2), multiply_add(one, weight_2, row2_2)
                one = spread(blocks, here + 3)
                row3, row3_2 = multiply_add(one, weight, row3), multiply_add(one, weight_2, row3_2)
                one = spread(blocks, here + 4)
                row4, row4_2 = multiply_add(one, weight, row4), multiply_add(one, weight_2, row4_2)
                one = spread(blocks, here + 5)
                row5, row5_2 = multiply_add(one, weight, row5), multiply_add(one, weight_2, row5_2)
                here += LANES
                place += UNITS
            to, other = first * units + unit, len(biases)
            _put(row0, row0_2, results, to, other, follows)
            _put(row1, row1_2, results, to + units, other, follows)
            _put(row2, row2_2, results, to + 2 * units, other, follows)
            _put(row3, row3_2, results, to + 3 * units, other, follows)
            _put(row4, row4_2, results, to + 4 * units, other, follows)
            _put(row5, row5_2, results, to + 5 * units, other, follows)


@kernel
def _put(units: Any, units_2: Any, results: Array, place: int, other: int, follows: int) -> None:
    """Write sixteen units of a row, or what follows of them; negated signs `other` numbers behind."""
    if follows == PLAIN:
        store(results, place, units)
        store(results, place + LANES, units_2)
    else:
        store(results, place, rectified(units))
        store(results, place + LANES, rectified(units_2))
    if follows == CRELU:
        store(results, place + other, rectified(negated(units)))
        store(results, place + other + LANES, rectified(negated(units_2)))
