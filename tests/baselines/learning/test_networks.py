"""The networks: the appendix's shapes and padding, against the plainest way to write them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch
from gymnasium import spaces
from torch import Tensor
from torch.nn import functional

from sprl_baselines.learning.distributions import Categorical, DiagonalGaussian
from sprl_baselines.learning.grids import grid_shape
from sprl_baselines.learning.networks import (
    LARGEST_CODES,
    ActorCritic,
    ScaledCells,
    actor_critic,
)

ACTIONS = spaces.Discrete(7)
FLAT = spaces.Box(-np.inf, np.inf, (16,), np.float64)


def seeded(seed: int = 0) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


def grid_space(size: int) -> spaces.Box:
    return spaces.Box(0, 255, (size, size, 3), np.uint8)


def grid_network(size: int = 7, seed: int = 0) -> ActorCritic:
    return actor_critic(grid_space(size), ACTIONS, seeded(seed))


def random_grids(count: int, size: int = 7) -> Tensor:
    codes = [torch.randint(0, top + 1, (count, size, size), generator=seeded(1)) for top in LARGEST_CODES]
    return torch.stack(codes, dim=-1).to(torch.uint8)


def plain_forward(network: ActorCritic, grids: Tensor) -> tuple[Tensor, Tensor]:
    """Compute logits and values from the same parameters, channels first, with nothing clever."""
    layers = network.policy_trunk
    images = (grids / torch.tensor(LARGEST_CODES)).permute(0, 3, 1, 2).contiguous()
    for weight, bias in zip(layers[1].weights, layers[1].biases, strict=True):
        images = functional.conv2d(functional.pad(images, (0, 1, 0, 1)), weight, bias)
        images = torch.relu(torch.cat((images, -images), dim=1))
    responses = layers[2](images.permute(0, 2, 3, 1).flatten(1))
    features = torch.relu(torch.cat((responses, -responses), dim=1))
    return network.head.logits(features), network.value(features).squeeze(1)


@pytest.mark.parametrize("size", [7, 11])
def test_the_grid_network_equals_the_plain_one_in_outputs_and_gradients(size: int) -> None:
    network, grids = grid_network(size), random_grids(32, size)
    with torch.no_grad():
        network.head.logits.weight.mul_(100)  # from the tiny initial scale to one where errors would show
    results = []
    for forward in (network, lambda grids: plain_forward(network, grids)):
        logits, values = forward(grids)
        logs = logits.log_softmax(dim=1)
        network.zero_grad()
        (logs[:, 0].square().mean() + values.square().mean()).backward()
        results.append([logs.detach(), values.detach(), *[weights.grad.clone() for weights in network.parameters()]])
    for ours, plain in zip(*results, strict=True):
        torch.testing.assert_close(ours, plain, rtol=1e-4, atol=1e-5)


def test_the_grid_network_has_the_appendix_shapes() -> None:
    shapes = {name: tuple(value.shape) for name, value in grid_network().named_parameters()}
    assert shapes == {
        "policy_trunk.1.weights.0": (16, 3, 2, 2),
        "policy_trunk.1.weights.1": (8, 32, 2, 2),
        "policy_trunk.1.weights.2": (8, 16, 2, 2),
        "policy_trunk.1.biases.0": (16,),
        "policy_trunk.1.biases.1": (8,),
        "policy_trunk.1.biases.2": (8,),
        "policy_trunk.2.weight": (512, 7 * 7 * 16),
        "policy_trunk.2.bias": (512,),
        "head.logits.weight": (7, 1024),
        "head.logits.bias": (7,),
        "value.weight": (1, 1024),
        "value.bias": (1,),
    }


def test_scaled_cells() -> None:
    scaled = ScaledCells()(torch.tensor([[[[10, 5, 3], [5, 0, 1]]]], dtype=torch.uint8))
    torch.testing.assert_close(scaled[0, :, 0, :].T, torch.tensor([[1.0, 1.0, 1.0], [0.5, 0.0, 1 / 3]]))


def test_heads_give_the_parameters_of_their_distributions() -> None:
    network = grid_network()
    parameters, values = network(random_grids(3))
    torch.testing.assert_close(parameters.exp().sum(dim=1), torch.ones(3))
    assert values.shape == network.head.distribution(parameters).entropy().shape == (3,)
    flat = actor_critic(FLAT, spaces.Box(-1, 1, (4,)), seeded())
    means, _ = flat(torch.randn(5, 16, generator=seeded()).double())
    assert flat.head.distribution(means) == DiagonalGaussian(means, flat.head.log_std)


def test_grids_share_one_trunk_and_flat_observations_have_two() -> None:
    assert grid_network().shared
    network = actor_critic(FLAT, spaces.Box(-1, 1, (4,)), seeded())
    assert not network.shared
    sizes = [layer.weight.shape for layer in network.value_trunk if hasattr(layer, "weight")]
    assert sizes == [(256, 16), (256, 256), (256, 256), (256, 256)]


@pytest.mark.parametrize("space", [grid_space(7), FLAT])
def test_values_alone_are_those_of_the_whole(space: spaces.Box) -> None:
    network = actor_critic(space, ACTIONS, seeded())
    observations = random_grids(5) if space.dtype == np.uint8 else torch.randn(5, 16, generator=seeded()).double()
    torch.testing.assert_close(network.values(observations), network(observations)[1], rtol=1e-5, atol=1e-7)


def test_parameters_follow_from_the_generator_alone() -> None:
    before = torch.get_rng_state()
    first, second, other = (grid_network(seed=seed).state_dict() for seed in (1, 1, 2))
    assert torch.equal(torch.get_rng_state(), before)
    assert all(torch.equal(first[name], second[name]) for name in first)
    assert not torch.equal(first["value.weight"], other["value.weight"])


def test_layers_start_orthogonal_with_their_gains() -> None:
    network = grid_network()
    hidden, logits = network.policy_trunk[2].weight, network.head.logits.weight
    torch.testing.assert_close(hidden @ hidden.T, torch.eye(512), rtol=0, atol=1e-4)
    torch.testing.assert_close(logits @ logits.T, 1e-4 * torch.eye(7), rtol=0, atol=1e-8)
    assert network.value.weight.norm().item() == pytest.approx(1.0)
    flat = actor_critic(FLAT, ACTIONS, seeded()).policy_trunk[2].weight
    torch.testing.assert_close(flat @ flat.T, 2.0 * torch.eye(256), rtol=0, atol=1e-4)


@pytest.mark.parametrize(
    ("shape", "found"),
    [((32, 32, 3), (32, 32, 1)), ((7, 11, 6), (7, 11, 2)), ((33, 8, 3), None), ((8, 33, 3), None), ((8, 8, 4), None)],
)
def test_grids_are_told_by_their_shape(shape: tuple[int, ...], found: tuple[int, int, int] | None) -> None:
    assert grid_shape(spaces.Box(0, 255, shape, np.uint8)) == found
    assert grid_shape(spaces.Box(0, 255, shape, np.float32)) is None


@pytest.mark.parametrize(
    ("observations", "actions", "complaint"),
    [
        (spaces.Box(0, 1, (4, 4), np.float32), ACTIONS, "observation_space is .*; it must be"),
        (spaces.Discrete(5), ACTIONS, "observation_space is .*; it must be"),
        (
            spaces.Box(0, 255, (35, 84, 3), np.uint8),
            ACTIONS,
            r"must be \(H, W, 3\) uint8 with at most 32 cells .*, images, .* at least 36 pixels .*, or a flat Box\.",
        ),
        (FLAT, spaces.MultiDiscrete([2, 2]), "action_space is .*; it must be"),
        (FLAT, spaces.Discrete(3, start=1), "action_space is .*; it must be"),
    ],
)
def test_spaces_without_a_network_are_refused(observations: Any, actions: Any, complaint: str) -> None:
    with pytest.raises(ValueError, match=complaint):
        actor_critic(observations, actions, seeded())


# ------------------------------------------------------------------------------------- distributions


def test_categorical_agrees_with_torch() -> None:
    logits = torch.randn(6, 4, generator=seeded())
    actions = torch.tensor([0, 1, 2, 3, 0, 1])
    ours, theirs = Categorical(logits.log_softmax(dim=1)), torch.distributions.Categorical(logits=logits)
    torch.testing.assert_close(ours.log_prob(actions), theirs.log_prob(actions))
    torch.testing.assert_close(ours.entropy(), theirs.entropy())


def test_gaussian_agrees_with_torch() -> None:
    mean, log_std = torch.randn(5, 3, generator=seeded()), torch.tensor([-1.0, 0.0, 0.5])
    actions = torch.randn(5, 3, generator=seeded(1))
    ours, theirs = DiagonalGaussian(mean, log_std), torch.distributions.Normal(mean, log_std.exp())
    torch.testing.assert_close(ours.log_prob(actions), theirs.log_prob(actions).sum(dim=1))
    torch.testing.assert_close(ours.entropy(), theirs.entropy().sum(dim=1))


def test_categorical_draws_have_the_right_frequencies() -> None:
    shares = torch.tensor([0.5, 0.3, 0.15, 0.05])
    draws = Categorical(shares.log().expand(20_000, 4)).sample(seeded())
    # four standard errors of a share of one half in 20,000 draws
    torch.testing.assert_close(torch.bincount(draws) / 20_000, shares, rtol=0, atol=0.015)


def test_gaussian_draws_have_the_right_moments() -> None:
    draws = DiagonalGaussian(torch.tensor([[1.0, -2.0]]).expand(20_000, 2), torch.tensor([0.0, 1.0])).sample(seeded())
    torch.testing.assert_close(draws.mean(dim=0), torch.tensor([1.0, -2.0]), rtol=0, atol=0.08)
    torch.testing.assert_close(draws.std(dim=0), torch.tensor([1.0, np.e], dtype=torch.float32), rtol=0.03, atol=0)
