"""Sums through the steps of a rollout, against loops over tensors."""

from __future__ import annotations

from typing import Any

import pytest
import torch
from torch import Tensor

from sprl_baselines.kernels.scans import sums_backward, sums_forward


def drawn(steps: int, envs: int, dtype: Any) -> tuple[Tensor, Tensor, Tensor]:
    """Return values, what is carried, and what was before."""
    generator = torch.Generator().manual_seed(steps)
    values, carry = torch.randn(2, steps, envs, generator=generator, dtype=dtype)
    return values, carry * (carry > 0), torch.randn(envs, generator=generator, dtype=dtype)


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
@pytest.mark.parametrize(("steps", "envs"), [(1, 1), (1, 3), (5, 1), (256, 12)])
def test_backward(steps: int, envs: int, dtype: Any) -> None:
    values, carry, _ = drawn(steps, envs, dtype)
    given, expected = values.clone(), values.clone()
    for step in range(steps - 2, -1, -1):
        expected[step] += carry[step] * expected[step + 1]
    found = sums_backward(values, carry)
    assert found.dtype == dtype
    torch.testing.assert_close(found, expected)
    assert torch.equal(values, given)


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
@pytest.mark.parametrize(("steps", "envs"), [(1, 1), (1, 3), (5, 1), (256, 12)])
def test_forward(steps: int, envs: int, dtype: Any) -> None:
    values, carry, first = drawn(steps, envs, dtype)
    expected, before = values.clone(), first
    for step in range(steps):
        expected[step] += carry[step] * before
        before = expected[step]
    found = sums_forward(values, carry, first)
    assert found.dtype == dtype
    torch.testing.assert_close(found, expected)


def test_tensors_that_do_not_lie_in_order_are_read_all_the_same() -> None:
    values, carry, first = drawn(5, 5, torch.float32)
    expected = sums_forward(values, carry.t().contiguous(), first)
    assert torch.equal(sums_forward(values, carry.t(), first), expected)
