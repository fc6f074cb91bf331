"""The compiled convolutions, against PyTorch's own in double precision."""

from __future__ import annotations

from typing import Any

import hypothesis.strategies as st
import pytest
import torch
from hypothesis import assume, example, given
from torch import Tensor
from torch.nn import functional

from sprl_baselines.kernels.convolution_loops import BLOCK
from sprl_baselines.kernels.convolutions import CReLUConvolutions


def seeded(seed: int = 0) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


def convolutions(inputs: int = 3, outputs: tuple[int, ...] = (16, 8, 8)) -> CReLUConvolutions:
    made = CReLUConvolutions(inputs, outputs, 1.4, seeded())
    with torch.no_grad():
        for bias in made.biases:
            bias.normal_(generator=seeded(1))
    return made


def learned(network: CReLUConvolutions, images: Tensor, direction: Tensor) -> list[Tensor]:
    """Return the features of images, and the gradient of each parameter along a direction of the features."""
    features = network(images)
    return [features.detach(), *torch.autograd.grad((features * direction).sum(), list(network.parameters()))]


def plainly(network: CReLUConvolutions, images: Tensor, direction: Tensor) -> list[Tensor]:
    """Return the same from PyTorch's convolutions, in double precision; skip what rounding may take across 0."""
    weights = [weight.detach().double().requires_grad_() for weight in network.weights]
    biases = [bias.detach().double().requires_grad_() for bias in network.biases]
    planes = images.double()
    for weight, bias in zip(weights, biases, strict=True):
        planes = functional.conv2d(functional.pad(planes, (0, 1, 0, 1)), weight, bias)
        assume(bool((planes.abs() > 1e-6).all()))  # there a rectifier's gradient is either of two
        planes = torch.cat((planes, -planes), dim=1).relu()
    features = planes.permute(0, 2, 3, 1).flatten(1)
    return [features.detach(), *torch.autograd.grad((features * direction.double()).sum(), [*weights, *biases])]


SIZES = {"height": st.integers(1, 6), "width": st.integers(1, 6), "count": st.integers(0, 70)}


@given(**SIZES, inputs=st.integers(1, 4), outputs=st.tuples(*[st.integers(1, 5)] * 3))
@example(height=7, width=7, count=40, inputs=3, outputs=(16, 8, 8))
@example(height=11, width=11, count=8, inputs=3, outputs=(16, 8, 8))
@example(height=40, width=30, count=2, inputs=1, outputs=(2, 1, 3))
def test_features_and_gradients_are_those_of_plain_convolutions(
    height: int, width: int, count: int, inputs: int, outputs: tuple[int, int, int]
) -> None:
    network = convolutions(inputs, outputs)
    images = torch.randn(count, inputs, height, width, generator=seeded(2))
    direction = torch.randn(count, height * width * 2 * outputs[-1], generator=seeded(3))
    for found, expected in zip(learned(network, images, direction), plainly(network, images, direction), strict=True):
        assert found.dtype == torch.float32
        torch.testing.assert_close(found.double(), expected, rtol=1e-4, atol=1e-4)


@pytest.mark.parametrize("channels", [1, 2, 4, 6, 2000])
def test_images_with_another_number_of_channels_are_refused(channels: int) -> None:
    with pytest.raises(ValueError, match=rf"Channels of images is {channels}; it must be 3"):
        convolutions()(torch.zeros(2, channels, 7, 7))


def test_precisions_are_not_mixed() -> None:
    with pytest.raises(RuntimeError, match="should be the same"):
        convolutions().double()(torch.zeros(2, 3, 7, 7))


@pytest.mark.parametrize("broken", [torch.nan, torch.inf])
def test_what_is_broken_in_one_image_stays_there(broken: float) -> None:
    images = torch.rand(40, 3, 7, 7, generator=seeded(2))
    images[5, 1, 3, 3] = broken
    finite = convolutions()(images).isfinite().all(dim=1)
    assert finite.logical_not().nonzero().tolist() == [[5]]


@pytest.mark.parametrize("place", range(6))
def test_a_parameter_that_is_not_a_number_is_seen(place: int) -> None:
    network = convolutions()
    with torch.no_grad():
        list(network.parameters())[place].view(-1)[0] = torch.nan
    assert network(torch.rand(3, 3, 7, 7, generator=seeded(2))).isnan().any()


def test_the_memory_format_of_images_does_not_matter() -> None:
    network, images = convolutions(), torch.rand(5, 3, 7, 7, generator=seeded(2))
    assert torch.equal(network(images), network(images.contiguous(memory_format=torch.channels_last)))


@pytest.mark.parametrize("count", [1, 7, 2 * BLOCK, 2 * BLOCK + 1])
def test_an_image_has_the_same_features_in_any_company(count: int) -> None:
    network, images = convolutions(), torch.rand(200, 3, 7, 7, generator=seeded(2))
    assert torch.equal(network(images[:count]), network(images)[:count])


def test_the_same_images_have_the_same_bits() -> None:
    network, images = convolutions(), torch.rand(100, 3, 7, 7, generator=seeded(2))
    direction = torch.randn(100, 7 * 7 * 16, generator=seeded(3))
    for first, second in zip(learned(network, images, direction), learned(network, images, direction), strict=True):
        assert torch.equal(first, second)


def test_images_and_incoming_gradients_are_left_alone() -> None:
    network, images = convolutions(), torch.rand(20, 3, 7, 7, generator=seeded(2))
    direction = torch.randn(20, 7 * 7 * 16, generator=seeded(3))
    before = images.clone(), direction.clone()
    network(images).backward(direction)
    assert torch.equal(images, before[0])
    assert torch.equal(direction, before[1])


def test_images_that_need_a_gradient_get_it() -> None:
    network, images = one_tap(1, 1), torch.tensor([[[[1.0, 2.0], [3.0, -4.0]]]], requires_grad=True)
    (network(images) * torch.arange(8.0)).sum().backward()
    assert images.grad is not None
    assert images.grad.tolist() == [[[[0, 0], [0, -1]]]]  # the only cell looked at, from the first: its negative part


def test_gradients_add_up() -> None:
    network, images = convolutions(), torch.rand(20, 3, 7, 7, generator=seeded(2))
    network(images).sum().backward()
    once = [parameter.grad.clone() for parameter in network.parameters()]
    network(images).sum().backward()
    for parameter, gradient in zip(network.parameters(), once, strict=True):
        torch.testing.assert_close(parameter.grad, 2 * gradient)


def test_nothing_is_recorded_under_inference_mode() -> None:
    with torch.inference_mode():
        assert not convolutions()(torch.rand(2, 3, 7, 7, generator=seeded())).requires_grad


def test_a_second_derivative_is_refused() -> None:
    network = convolutions()
    features = network(torch.rand(2, 3, 7, 7, generator=seeded()))
    (gradient,) = torch.autograd.grad(features.square().sum(), [network.weights[0]], create_graph=True)
    with pytest.raises(RuntimeError, match="once_differentiable"):
        gradient.sum().backward()


def one_tap(row: int, column: int) -> CReLUConvolutions:
    network = CReLUConvolutions(1, (1,), 1.0, seeded())
    with torch.no_grad():
        network.weights[0].zero_()
        network.weights[0][0, 0, row, column] = 1.0
    return network


@pytest.mark.parametrize("precision", [torch.float32, torch.float64])
def test_same_padding_is_at_the_bottom_and_on_the_right(precision: Any) -> None:
    images = torch.arange(1, 10, dtype=precision).view(1, 1, 3, 3)
    shifted = one_tap(1, 1).to(precision)(images).view(3, 3, 2)
    assert shifted[..., 0].tolist() == [[5, 6, 0], [8, 9, 0], [0, 0, 0]]
    assert not shifted[..., 1].any()


@pytest.mark.parametrize("precision", [torch.float32, torch.float64])
def test_the_rectifier_keeps_both_signs_apart(precision: Any) -> None:
    out = one_tap(0, 0).to(precision)(torch.tensor([[[[3.0, -2.0]]]], dtype=precision))
    assert out.tolist() == [[3.0, 0.0, 0.0, 2.0]]
