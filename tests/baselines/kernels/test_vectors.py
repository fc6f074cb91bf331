"""Vectors of eight numbers, against NumPy."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numba import njit
from numpy.typing import NDArray

from sprl_baselines.kernels import vectors
from sprl_baselines.kernels.vectors import LANES

Array = NDArray[np.float32]
SPECIAL = np.array([1.5, -2.5, 0.0, -0.0, np.nan, np.inf, -np.inf, 1e-30], np.float32)
NUMBERS = np.array([3.0, -1.0, 2.0, 0.5, -4.0, 8.0, 7.0, -6.0], np.float32)


def of_two(name: str) -> Array:
    """Apply an operation to the special numbers and the plain ones."""
    operation = getattr(vectors, name)

    @njit
    def apply(first: Array, second: Array, out: Array) -> None:
        vectors.store(out, 0, operation(vectors.load(first, 0), vectors.load(second, 0)))

    out = np.empty(LANES, np.float32)
    apply(SPECIAL, NUMBERS, out)
    return out


def of_one(name: str) -> Array:
    """Apply an operation to the special numbers."""
    operation = getattr(vectors, name)

    @njit
    def apply(numbers: Array, out: Array) -> None:
        vectors.store(out, 0, operation(vectors.load(numbers, 0)))

    out = np.empty(LANES, np.float32)
    apply(SPECIAL, out)
    return out


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("add", SPECIAL + NUMBERS),
        ("subtract", SPECIAL - NUMBERS),
        ("where_positive", np.where(SPECIAL > 0, NUMBERS, np.float32(0))),
    ],
)
def test_operations_on_two_vectors(name: str, expected: Array) -> None:
    np.testing.assert_array_equal(of_two(name), expected)


@pytest.mark.parametrize(
    ("name", "expected"), [("negated", -SPECIAL), ("rectified", np.where(SPECIAL < 0, np.float32(0), SPECIAL))]
)
def test_operations_on_one_vector(name: str, expected: Array) -> None:
    np.testing.assert_array_equal(of_one(name), expected)


def test_a_product_is_added() -> None:
    @njit
    def apply(numbers: Array, out: Array) -> None:
        one = vectors.load(numbers, 0)
        vectors.store(out, 0, vectors.multiply_add(one, one, vectors.spread(numbers, 2)))
        vectors.store(out, LANES, vectors.zeros())

    out = np.full(2 * LANES, np.nan, np.float32)
    apply(NUMBERS, out)
    np.testing.assert_array_equal(out, np.concatenate((NUMBERS**2 + 2, np.zeros(LANES, np.float32))))


@pytest.mark.parametrize(("step", "stride"), [(8, 8), (11, 8), (8, 13), (20, 9)])
def test_rows_become_columns_and_nothing_else_changes(step: int, stride: int) -> None:
    @njit
    def apply(source: Array, step: int, out: Array, stride: int) -> None:
        vectors.transpose(source, 3, step, out, 2, stride)

    source = np.arange(200, dtype=np.float32)
    out = np.full(200, -1, np.float32)
    expected: Any = out.copy()
    for row in range(LANES):
        for column in range(LANES):
            expected[2 + stride * row + column] = source[3 + step * column + row]
    apply(source, step, out, stride)
    np.testing.assert_array_equal(out, expected)
