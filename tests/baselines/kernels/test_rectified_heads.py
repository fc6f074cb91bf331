"""Units behind concatenated rectifiers, against PyTorch's modules in double precision."""

from __future__ import annotations

from typing import Any

import hypothesis.strategies as st
import pytest
import torch
from hypothesis import example, given
from torch import Tensor
from torch.nn import functional

from sprl_baselines.kernels.rectified_heads import rectified_linear


def tensors(count: int, features: int, units: int, dtype: Any = torch.float32) -> list[Tensor]:
    """Return responses, weights and biases that ask for gradients."""
    generator = torch.Generator().manual_seed(count)
    shapes = (count, features), (units, 2 * features), (units,)
    return [torch.randn(shape, generator=generator).to(dtype).requires_grad_() for shape in shapes]


def plainly(responses: Tensor, weight: Tensor, bias: Tensor) -> Tensor:
    return functional.linear(torch.cat((responses, -responses), dim=1).relu(), weight, bias)


def with_gradients(function: Any, inputs: list[Tensor]) -> list[Tensor]:
    """Return the units, and the gradients of all inputs along a direction of the units."""
    units = function(*inputs)
    direction = torch.randn(units.shape, generator=torch.Generator().manual_seed(1)).to(units.dtype)
    return [units.detach(), *torch.autograd.grad((units * direction).sum(), inputs)]


@given(count=st.integers(0, 40), features=st.integers(1, 5), units=st.integers(1, 20), odd=st.booleans())
@example(count=384, features=64, units=8, odd=False)
def test_units_and_gradients_are_those_of_plain_modules(count: int, features: int, units: int, odd: bool) -> None:
    inputs = tensors(count, 8 * features + odd, units)
    found = with_gradients(rectified_linear, inputs)
    expected = with_gradients(plainly, [one.detach().double().requires_grad_() for one in inputs])
    for one, other in zip(found, expected, strict=True):
        assert one.dtype == torch.float32
        torch.testing.assert_close(one.double(), other, rtol=1e-4, atol=1e-4)


def test_the_same_inputs_have_the_same_bits() -> None:
    inputs = tensors(100, 64, 8)
    for first, second in zip(*(with_gradients(rectified_linear, inputs) for _ in range(2)), strict=True):
        assert torch.equal(first, second)


def test_other_precisions_are_kept() -> None:
    assert rectified_linear(*tensors(5, 16, 3, torch.float64)).dtype == torch.float64


@pytest.mark.parametrize("place", range(3))
def test_what_is_not_a_number_is_seen(place: int) -> None:
    inputs = [one.detach() for one in tensors(5, 16, 3)]
    inputs[place].view(-1)[0] = torch.nan
    assert rectified_linear(*inputs).isnan().any()


def test_a_response_of_zero_has_no_gradient() -> None:
    _, weight, bias = tensors(1, 8, 2)
    responses = torch.zeros(1, 8, requires_grad=True)
    (gradient,) = torch.autograd.grad(rectified_linear(responses, weight, bias).sum(), responses)
    assert not gradient.any()
