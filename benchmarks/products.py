"""The matrix products that an MLP's learner cannot avoid, at the batch sizes at which it needs them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise
from math import prod

import torch

Product = tuple[int, int, int]
"""`[rows, inner] @ [inner, columns]`."""


def forward(widths: Sequence[int], batch: int) -> list[Product]:
    """Return the products of one pass through layers of these widths, the input's first."""
    return [(batch, before, after) for before, after in pairwise(widths)]


def gradient(widths: Sequence[int], batch: int) -> list[Product]:
    """Return the products of a gradient: forwards, then back to all weights and to all layers but the input."""
    weights = [(before, batch, after) for before, after in pairwise(widths)]
    layers = [(batch, after, before) for before, after in pairwise(widths[1:])]
    return [*forward(widths, batch), *weights, *layers]


def flops(products: Sequence[Product]) -> int:
    """Return the multiplications and additions of all."""
    return sum(2 * prod(product) for product in products)


def multiplier(products: Sequence[Product]) -> Callable[[], None]:
    """Return a function that computes all of them, in memory that is allocated here."""
    factors = {
        (rows, inner, columns): (torch.randn(rows, inner), torch.randn(inner, columns), torch.empty(rows, columns))
        for rows, inner, columns in set(products)
    }

    def multiply() -> None:
        for product in products:
            left, right, result = factors[product]
            torch.mm(left, right, out=result)

    return multiply
