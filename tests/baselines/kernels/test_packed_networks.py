"""Networks laid out for acting, against the modules that they are made of."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import hypothesis.strategies as st
import pytest
import torch
from hypothesis import example, given
from torch import Tensor, nn
from torch.nn import functional

from sprl_baselines.kernels.convolutions import CReLUConvolutions
from sprl_baselines.kernels.packed_networks import PackedGridNetwork, PackedMLP


def seeded(seed: int = 0) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


def randomised(module: nn.Module) -> None:
    with torch.no_grad():
        for parameter in module.parameters():
            parameter.normal_(std=parameter[0].numel() ** -0.5, generator=seeded(1))


def linears(widths: tuple[int, ...], signs: int = 1) -> list[nn.Linear]:
    """Return layers of these widths; each but the first sees `signs` numbers of every unit before it."""
    fan_ins = [widths[0], *(signs * width for width in widths[1:])]
    layers = [nn.Linear(fan_in, width) for fan_in, width in zip(fan_ins, widths[1:], strict=False)]
    for layer in layers:
        randomised(layer)
    return layers


def heads(features: int, units: tuple[int, ...]) -> list[nn.Linear]:
    return [linears((features, count))[0] for count in units]


def both_signs(responses: Tensor) -> Tensor:
    return torch.cat((responses, -responses), dim=1).relu()


def plainly(rows: Tensor, layers: list[nn.Linear], ends: list[nn.Linear], act: Callable[[Tensor], Tensor]) -> Tensor:
    """Return what the modules compute, in double precision."""
    rows = rows.double()
    for layer in layers:
        rows = act(functional.linear(rows, layer.weight.double(), layer.bias.double()))
    return torch.cat([functional.linear(rows, end.weight.double(), end.bias.double()) for end in ends], dim=1).detach()


@given(count=st.integers(0, 20), widths=st.lists(st.integers(1, 40), min_size=2, max_size=4), units=st.integers(1, 20))
@example(count=12, widths=[16, 256, 256, 256, 256], units=4)
@example(count=30, widths=[16, 256, 256, 256, 256], units=4)
@pytest.mark.parametrize("activation", ["relu", "crelu"])
def test_an_mlp_gives_what_its_layers_give(activation: str, count: int, widths: list[int], units: int) -> None:
    signs, act = {"relu": (1, torch.relu), "crelu": (2, both_signs)}[activation]
    layers, ends = linears(tuple(widths), signs), heads(signs * widths[-1], (units, 1))
    rows = torch.randn(count, widths[0], generator=seeded(2))
    found = PackedMLP(layers, ends, activation)(rows)
    torch.testing.assert_close(found.double(), plainly(rows, layers, ends, act), rtol=1e-5, atol=1e-5)


@given(sides=st.tuples(st.integers(1, 5), st.integers(1, 5)), count=st.integers(0, 20), inputs=st.integers(1, 9))
@example(sides=(7, 7), count=12, inputs=3)
@example(sides=(11, 11), count=12, inputs=21)
def test_a_grid_network_gives_what_its_modules_give(sides: tuple[int, int], count: int, inputs: int) -> None:
    convolutions = CReLUConvolutions(inputs, (16, 8, 8), 1.0, seeded())
    wide, ends = linears((sides[0] * sides[1] * 16, 50)), heads(100, (7, 1))
    images = torch.rand(count, inputs, *sides, generator=seeded(2))
    with torch.no_grad():
        expected = plainly(convolutions(images), wide, ends, both_signs)
    found = PackedGridNetwork(convolutions, wide, ends)(images)
    torch.testing.assert_close(found.double(), expected, rtol=1e-5, atol=1e-5)


def small() -> tuple[list[nn.Linear], PackedMLP, Tensor]:
    layers = linears((16, 32, 32))
    ends = heads(32, (4,))
    return [*layers, *ends], PackedMLP(layers, ends), torch.randn(12, 16, generator=seeded(2))


def test_it_keeps_the_parameters_that_the_layers_had() -> None:
    layers, packed, rows = small()
    before = packed(rows)
    with torch.no_grad():
        for layer in layers:
            layer.weight.zero_()
            layer.bias.fill_(1)
    assert torch.equal(packed(rows), before)
    assert (PackedMLP(layers[:-1], layers[-1:])(rows) == 1).all()


def test_the_same_rows_have_the_same_bits_in_any_company() -> None:
    _, packed, rows = small()
    assert torch.equal(packed(rows), packed(rows.clone()))
    for first, last in pairwise([0, 1, 5, 12]):
        assert torch.equal(packed(rows[first:last]), packed(rows)[first:last])


def test_what_is_not_a_number_stays_in_its_row() -> None:
    _, packed, rows = small()
    rows[5, 3] = torch.nan
    assert packed(rows).isfinite().all(dim=1).logical_not().nonzero().tolist() == [[5]]


def test_a_parameter_that_is_not_a_number_is_seen() -> None:
    layers, _, rows = small()
    with torch.no_grad():
        layers[1].bias[3] = torch.nan
    assert PackedMLP(layers[:-1], layers[-1:])(rows).isnan().all()


def test_no_gradient_is_recorded() -> None:
    _, packed, rows = small()
    assert not packed(rows).requires_grad


def test_rows_of_another_width_are_refused() -> None:
    with pytest.raises(ValueError, match=r"The rows have 15 features; they need 16\."):
        small()[1](torch.zeros(3, 15))


@pytest.mark.parametrize(
    ("shape", "message"),
    [((2, 4, 7, 7), r"Channels of images is 4; it must be 3\."), ((2, 3, 7, 8), "896 features; they need 784")],
)
def test_images_of_another_shape_are_refused(shape: tuple[int, ...], message: str) -> None:
    network = PackedGridNetwork(CReLUConvolutions(3, (16, 8, 8), 1.0, seeded()), linears((784, 16)), heads(32, (7,)))
    with pytest.raises(ValueError, match=message):
        network(torch.zeros(shape))
