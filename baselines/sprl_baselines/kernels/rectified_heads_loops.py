"""A few units that see both rectified signs of many, compiled for the CPU: forward and backward.

PyTorch writes the signs down before it multiplies them, and its products are slow where one side is eight. Here each
row's signs are made in registers, for eight units at a time.
"""

from __future__ import annotations

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
    sum0, sum1, sum2, sum3, sum4, sum5, sum6, sum7 = (
        zeros(),
        zeros(),
        zeros(),
        zeros(),
        zeros(),
        zeros(),
        zeros(),
        zeros(),
    )
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
    """Add the gradients of responses and weights, from that of the units."""
    rows, features = responses.shape
    inputs, matrix, errors = responses.reshape(-1), weights.reshape(-1), gradient.reshape(-1)
    back, sums, units = response_gradient.reshape(-1), weight_gradient.reshape(-1), len(weights)
    for row in range(rows):
        for unit in range(0, units, LANES):
            place, first, step = row * features, unit * 2 * features, 2 * features
            error = row * units + unit
            for feature in range(0, features, LANES):
                response, to = load(inputs, place + feature), first + feature
                up, down, upward, downward = rectified(response), rectified(negated(response)), zeros(), zeros()
                for other in range(LANES):
                    here, one = to + other * step, spread(errors, error + other)
                    upward = multiply_add(one, load(matrix, here), upward)
                    downward = multiply_add(one, load(matrix, here + features), downward)
                    store(sums, here, multiply_add(one, up, load(sums, here)))
                    store(sums, here + features, multiply_add(one, down, load(sums, here + features)))
                found = subtract(where_positive(response, upward), where_positive(negated(response), downward))
                store(back, place + feature, add(load(back, place + feature), found))
