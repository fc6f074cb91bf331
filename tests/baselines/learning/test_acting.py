"""Acting by the compiled form and by the plain one: the same answers, and the same as the network that learns."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from gymnasium import spaces
from torch.testing import assert_close

from sprl_baselines.learning.acting import acting, compiled, plain
from sprl_baselines.learning.networks import ActorCritic, actor_critic
from sprl_baselines.learning.observations import NormalizedObservations

GRID = spaces.Box(0, 255, (7, 7, 3), np.uint8)
FLAT = spaces.Box(-np.inf, np.inf, (16,), np.float64)


def grid_network() -> ActorCritic:
    return actor_critic(GRID, spaces.Discrete(7), torch.Generator().manual_seed(3))


def flat_network() -> ActorCritic:
    view = NormalizedObservations(16, 5.0)
    view.update(torch.randn(100, 16, dtype=torch.float64) + 1.3)
    return actor_critic(FLAT, spaces.Box(-1, 1, (4,)), torch.Generator().manual_seed(3), view=view)


def observations_of(space: spaces.Box, count: int) -> torch.Tensor:
    generator = np.random.default_rng(count)
    drawn = (
        generator.integers(0, 4, (count, *space.shape)) if space is GRID else generator.normal(1.3, 0.2, (count, 16))
    )
    return torch.from_numpy(drawn.astype(space.dtype))


@pytest.mark.parametrize("count", [1, 2, 8, 12, 13, 30])
@pytest.mark.parametrize(("space", "make"), [(GRID, grid_network), (FLAT, flat_network)])
def test_the_compiled_form_equals_the_plain_one(space: spaces.Box, make, count: int) -> None:
    network, observations = make(), observations_of(space, count)
    with torch.inference_mode():
        expected, values = network(observations)
        for form in (plain(network), compiled(network), acting(network)):
            parameters, own_values = form(observations)
            assert_close(parameters, expected, rtol=1e-4, atol=1e-6)
            assert (own_values is None) == (not network.shared)
            if own_values is not None:
                assert_close(own_values, values, rtol=1e-4, atol=1e-6)


@pytest.mark.parametrize(("space", "make"), [(GRID, grid_network), (FLAT, flat_network)])
def test_what_acts_keeps_the_parameters_it_was_made_with(space: spaces.Box, make) -> None:
    network, observations = make(), observations_of(space, 12)
    with torch.inference_mode():
        form = acting(network)
        before = form(observations)[0].clone()
        for parameter in network.parameters():
            parameter.mul_(1.5)
        assert_close(form(observations)[0], before, rtol=0, atol=0)
        assert not torch.allclose(acting(network)(observations)[0], before)
