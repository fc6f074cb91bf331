"""A few units that see both rectified signs of many, compiled for the CPU: forward and backward.

PyTorch writes the signs down before it multiplies them, and its products are slow where one side is eight. Here each
row's signs are made in registers, for eight units at a time.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from sprl_baselines.kernels.compiling import Array, kernel
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
    zeros,
)

ROWS: Final = 16  # at a time on the way back: their responses stay in the nearest cache


@kernel
def forward(responses: Array, weights: Array, biases: Array, out: Array) -> None:
    """Fill `out` [B, U] from `responses` [B, F]; weights are [U, 2 F], and U and F multiples of 8."""
    rows, features = responses.shape
    inputs, matrix, results, units = responses.reshape(-1), weights.reshape(-1), out.reshape(-1), len(weights)
    sums = np.empty(LANES * LANES, np.float32)
    for row in range(rows):
        for unit in range(0, units, LANES):
            _sums(inputs, row * features, matrix, unit * 2 * features, features, sums)
            total = load(biases, unit)
            for place in range(0, LANES * LANES, LANES):
                total = add(total, load(sums, place))
            store(results, row * units + unit, total)


@kernel
def _sums(inputs: Array, place: int, weights: Array, first: int, features: int, sums: Array) -> None:
    """Fill `sums` [8, 8] with what has to be added up to eight units of a row: a unit in each lane."""
    step = 2 * features
    sum0, sum1, sum2, sum3 = zeros(), zeros(), zeros(), zeros()
    sum4, sum5, sum6, sum7 = zeros(), zeros(), zeros(), zeros()
    for feature in range(0, features, LANES):
        response = load(inputs, place + feature)
        up, down, to = rectified(response), rectified(negated(response)), first + feature
        for signs in (up, down):
            sum0 = multiply_add(signs, load(weights, to), sum0)
            sum1 = multiply_add(signs, load(weights, to + step), sum1)
            sum2 = multiply_add(signs, load(weights, to + 2 * step), sum2)
            sum3 = multiply_add(signs, load(weights, to + 3 * step), sum3)
            sum4 = multiply_add(signs, load(weights, to + 4 * step), sum4)
            sum5 = multiply_add(signs, load(weights, to + 5 * step), sum5)
            sum6 = multiply_add(signs, load(weights, to + 6 * step), sum6)
            sum7 = multiply_add(signs, load(weights, to + 7 * step), sum7)
            to += features
    store(sums, 0, sum0)
    store(sums, LANES, sum1)
    store(sums, 2 * LANES, sum2)
    store(sums, 3 * LANES, sum3)
    store(sums, 4 * LANES, sum4)
    store(sums, 5 * LANES, sum5)
    store(sums, 6 * LANES, sum6)
    store(sums, 7 * LANES, sum7)
    transpose(sums, 0, LANES, sums, 0, LANES)


@kernel
def backward(
    responses: Array, weights: Array, gradient: Array, response_gradient: Array, weight_gradient: Array
) -> None:
    """Fill the gradient of the responses, and add that of the weights, from that of the units."""
    rows, features = responses.shape
    inputs, matrix, errors = responses.reshape(-1), weights.reshape(-1), gradient.reshape(-1)
    back, sums, units = response_gradient.reshape(-1), weight_gradient.reshape(-1), len(weights)
    for first in range(0, rows, ROWS):
        last = min(first + ROWS, rows)
        for unit in range(0, units, LANES):
            for feature in range(0, features, LANES):
                to = unit * 2 * features + feature
                _add_weights(inputs, errors, first, last, features, units, unit, feature, False, sums, to)
                _add_weights(inputs, errors, first, last, features, units, unit, feature, True, sums, to + features)
                _add_back(inputs, errors, first, last, features, units, unit, feature, matrix, back)


@kernel
def _add_weights(
    inputs: Array,
    errors: Array,
    first: int,
    last: int,
    features: int,
    units: int,
    unit: int,
    feature: int,
    negate: bool,
    sums: Array,
    to: int,
) -> None:
    """Add the gradients of eight units' weights for one sign of eight responses, from rows `first` to `last`."""
    step = 2 * features
    sum0, sum1, sum2, sum3 = load(sums, to), load(sums, to + step), load(sums, to + 2 * step), load(sums, to + 3 * step)
    sum4, sum5 = load(sums, to + 4 * step), load(sums, to + 5 * step)
    sum6, sum7 = load(sums, to + 6 * step), load(sums, to + 7 * step)
    for row in range(first, last):
        response, error = load(inputs, row * features + feature), row * units + unit
        signs = rectified(negated(response)) if negate else rectified(response)
        sum0 = multiply_add(signs, spread(errors, error), sum0)
        sum1 = multiply_add(signs, spread(errors, error + 1), sum1)
        sum2 = multiply_add(signs, spread(errors, error + 2), sum2)
        sum3 = multiply_add(signs, spread(errors, error + 3), sum3)
        sum4 = multiply_add(signs, spread(errors, error + 4), sum4)
        sum5 = multiply_add(signs, spread(errors, error + 5), sum5)
        sum6 = multiply_add(signs, spread(errors, error + 6), sum6)
        sum7 = multiply_add(signs, spread(errors, error + 7), sum7)
    store(sums, to, sum0)
    store(sums, to + step, sum1)
    store(sums, to + 2 * step, sum2)
    store(sums, to + 3 * step, sum3)
    store(sums, to + 4 * step, sum4)
    store(sums, to + 5 * step, sum5)
    store(sums, to + 6 * step, sum6)
    store(sums, to + 7 * step, sum7)


@kernel
def _add_back(
    inputs: Array,
    errors: Array,
    first: int,
    last: int,
    features: int,
    units: int,
    unit: int,
    feature: int,
    weights: Array,
    back: Array,
) -> None:
    """Fill the gradients of eight responses in rows `first` to `last` by the first eight units, or add by others."""
    for row in range(first, last):
        place, upward, downward = row * features + feature, zeros(), zeros()
        for other in range(LANES):
            error, here = spread(errors, row * units + unit + other), (unit + other) * 2 * features + feature
            upward = multiply_add(error, load(weights, here), upward)
            downward = multiply_add(error, load(weights, here + features), downward)
        response = load(inputs, place)
        found = subtract(where_positive(response, upward), where_positive(negated(response), downward))
        store(back, place, add(load(back, place), found) if unit else found)
