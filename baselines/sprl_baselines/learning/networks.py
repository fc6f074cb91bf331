"""The policy and value networks, one per kind of observation: the grid's CNN (appendix D.3) and the MLP (G.4).

All parameters are drawn from the generator that is passed in; torch's global random state is never touched.
"""

from __future__ import annotations

from itertools import pairwise
from math import sqrt
from typing import Any, Protocol

import torch
from gymnasium import spaces
from torch import Tensor, nn
from torch.nn import functional
from torch.nn.utils import skip_init

from sprl_baselines.kernels.convolutions import CReLUConvolutions
from sprl_baselines.learning.distributions import Categorical, DiagonalGaussian, Distribution
from sprl_baselines.learning.grids import GRIDS, grid_shape
from sprl_baselines.learning.observations import RAW, View

# The largest type, colour and state (or direction) that a grid cell can hold.
LARGEST_CODES = (10, 5, 3)
POLICY_GAIN, VALUE_GAIN = 0.01, 1.0
# The published code has sqrt(2) before its plain rectifiers. Before concatenated ones, which give twice the features,
# Table 1's larger learning rate ends exploration in the first updates with it, but not with 1 (docs/grid-network.md).
RELU_GAIN, CRELU_GAIN = sqrt(2), 1.0


class Head(Protocol):
    """Turns features into distributions over actions."""

    def __call__(self, features: Tensor) -> Tensor:
        """Return the parameters of one distribution for each row, `[B, F]` -> `[B, A]`."""

    def distribution(self, parameters: Tensor) -> Distribution:
        """Return the distributions with these parameters `[B, A]`."""


class ActorCritic(nn.Module):
    """A policy and a value function of the same observation.

    `value_trunk` may be the same module as `policy_trunk`: it then runs, and is stored, once.
    """

    def __init__(
        self, view: View, policy_trunk: nn.Module, value_trunk: nn.Module, head: Head, value: nn.Module
    ) -> None:
        super().__init__()
        self.view = view
        self.policy_trunk = policy_trunk
        self.head = head
        self.value = value
        self.shared = value_trunk is policy_trunk
        if not self.shared:
            self.value_trunk = value_trunk

    def forward(self, observations: Tensor) -> tuple[Tensor, Tensor]:
        """Return the parameters of the action distributions `[B, A]`, and the values `[B]`, of B observations."""
        seen = self.view(observations)
        features = self.policy_trunk(seen)
        value_features = features if self.shared else self.value_trunk(seen)
        return self.head(features), self.value(value_features).squeeze(-1)

    def values(self, observations: Tensor) -> Tensor:
        """The values alone, `[B]`."""
        trunk = self.policy_trunk if self.shared else self.value_trunk
        values: Tensor = self.value(trunk(self.view(observations))).squeeze(-1)
        return values


def actor_critic(
    observation_space: spaces.Space[Any],
    action_space: spaces.Space[Any],
    generator: torch.Generator,
    *,
    view: View = RAW,
    mlp_layers: int = 4,
    mlp_units: int = 256,
) -> ActorCritic:
    """The network for these spaces (of one sub-environment).

    Args:
        observation_space: `Box` of shape (H, W, 3) and dtype uint8 (a grid; 6, 9, ... for several in a stack), or a
            flat `Box`.
        action_space: `Discrete`, or a flat `Box`.
        generator: source of the initial parameters, on the CPU.
        view: what the network sees of an observation.
        mlp_layers: hidden layers of the MLP for flat observations.
        mlp_units: width of each.

    Raises:
        ValueError: if there is no network for such spaces.
    """
    if grid := grid_shape(observation_space):
        policy_trunk = value_trunk = grid_trunk(*grid, generator)
        features = 2 * GRID_UNITS
    elif isinstance(observation_space, spaces.Box) and len(observation_space.shape) == 1:
        sizes = observation_space.shape[0], mlp_layers, mlp_units
        policy_trunk, value_trunk = mlp_trunk(*sizes, generator), mlp_trunk(*sizes, generator)
        features = mlp_units
    else:
        raise ValueError(f"No network for observations in {observation_space}: need {GRIDS} or a flat Box.")
    head = policy_head(features, action_space, generator)
    return ActorCritic(view, policy_trunk, value_trunk, head, linear(features, 1, VALUE_GAIN, generator))


def linear(inputs: int, outputs: int, gain: float, generator: torch.Generator) -> nn.Linear:
    """A linear layer with orthogonal weights and zero bias."""
    layer: nn.Linear = skip_init(nn.Linear, inputs, outputs)  # type: ignore[no-untyped-call] # torch has no types there
    nn.init.orthogonal_(layer.weight, gain, generator)
    nn.init.zeros_(layer.bias)
    return layer


# ---------------------------------------------------------------------------------------------- heads


class CategoricalHead(nn.Module):
    """Logits for discrete actions."""

    def __init__(self, features: int, actions: int, generator: torch.Generator) -> None:
        super().__init__()
        self.logits = linear(features, actions, POLICY_GAIN, generator)

    def forward(self, features: Tensor) -> Tensor:
        """Return normalised log-probabilities, `[B, F]` -> `[B, A]`."""
        log_probabilities: Tensor = self.logits(features).log_softmax(dim=-1)
        return log_probabilities

    def distribution(self, parameters: Tensor) -> Distribution:
        """Return the categorical distributions with these log-probabilities `[B, A]`."""
        return Categorical(parameters)


class GaussianHead(nn.Module):
    """A mean for continuous actions, and a standard deviation that does not depend on the state, at first 1."""

    def __init__(self, features: int, actions: int, generator: torch.Generator) -> None:
        super().__init__()
        self.mean = linear(features, actions, POLICY_GAIN, generator)
        self.log_std = nn.Parameter(torch.zeros(actions))

    def forward(self, features: Tensor) -> Tensor:
        """Return means, `[B, F]` -> `[B, A]`."""
        means: Tensor = self.mean(features)
        return means

    def distribution(self, parameters: Tensor) -> Distribution:
        """Return the diagonal Gaussians with these means `[B, A]`."""
        return DiagonalGaussian(parameters, self.log_std)


def policy_head(features: int, action_space: spaces.Space[Any], generator: torch.Generator) -> Head:
    """The head for this action space."""
    match action_space:
        case spaces.Discrete(n=count, start=0):
            return CategoricalHead(features, int(count), generator)
        case spaces.Box(shape=(size,)):
            return GaussianHead(features, size, generator)
        case _:
            raise ValueError(f"No policy for actions in {action_space}: need Discrete (from 0) or a flat Box.")


# --------------------------------------------------------------------------------------------- trunks

GRID_CHANNELS = (16, 8, 8)
GRID_UNITS = 512


def grid_trunk(height: int, width: int, frames: int, generator: torch.Generator) -> nn.Sequential:
    """The grid network of appendix D.3 up to its last hidden layer, `[B, H, W, 3 * frames]` uint8 -> `[B, 1024]`."""
    convolutions, features = grid_convolutions(height, width, frames, generator)
    return nn.Sequential(*convolutions, linear(features, GRID_UNITS, CRELU_GAIN, generator), CReLU())


class CReLU(nn.Module):
    """Both rectified signs of every unit (Shang et al. 2016): one of the two always has a gradient."""

    def forward(self, responses: Tensor) -> Tensor:
        """`[B, F]` -> `[B, 2 F]`."""
        return functional.relu(torch.cat((responses, -responses), dim=1), inplace=True)


def grid_convolutions(height: int, width: int, frames: int, generator: torch.Generator) -> tuple[list[nn.Module], int]:
    """The three convolutions of appendix D.3 on encoded cells, and how many features `[B, F]` come of them."""
    cells = ScaledCells(frames)
    convolutions = CReLUConvolutions(cells.channels, GRID_CHANNELS, CRELU_GAIN, generator)
    return [cells, convolutions], height * width * 2 * GRID_CHANNELS[-1]


def mlp_trunk(inputs: int, layers: int, units: int, generator: torch.Generator) -> nn.Sequential:
    """The MLP of appendix G.4, `[B, inputs]` float32 -> `[B, units]`."""
    sizes = [inputs] + [units] * layers
    hidden = [
        module
        for fan_in, fan_out in pairwise(sizes)
        for module in (linear(fan_in, fan_out, RELU_GAIN, generator), nn.ReLU(inplace=True))
    ]
    return nn.Sequential(*hidden)


class ScaledCells(nn.Module):
    """Grid cells with each of type, colour and state divided by its largest value; of several frames, one by one."""

    def __init__(self, frames: int = 1) -> None:
        super().__init__()
        self.channels = len(LARGEST_CODES) * frames
        self.scale: Tensor
        self.register_buffer("scale", 1 / torch.tensor(LARGEST_CODES * frames), persistent=False)

    def forward(self, cells: Tensor) -> Tensor:
        """`[B, H, W, 3 F]` uint8 -> `[B, 3 F, H, W]` float32, in channels-last memory."""
        return (cells * self.scale).permute(0, 3, 1, 2)
