"""The policy and value networks: CNNs for grids (appendix D.3) and images (E.4, F.4), an MLP for flat ones (G.4).

All parameters are drawn from the generator that is passed in. Torch's global random state is never used.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Any, Protocol

import torch
from gymnasium import spaces
from torch import Tensor, nn
from torch.nn import functional

from sprl_baselines.kernels.convolutions import CReLUConvolutions
from sprl_baselines.kernels.rectified_heads import rectified_linear
from sprl_baselines.learning.distributions import Categorical, DiagonalGaussian, Distribution
from sprl_baselines.learning.grids import GRIDS, grid_shape
from sprl_baselines.learning.images import (
    IMAGES,
    NATURE_UNITS,
    ImageShape,
    Pixels,
    image_shape,
    nature_convolutions,
)
from sprl_baselines.learning.initialization import CRELU_GAIN, POLICY_GAIN, RELU_GAIN, VALUE_GAIN, linear
from sprl_baselines.learning.observations import RAW, View

# The largest type, colour and state (or direction) that a grid cell can hold.
LARGEST_CODES = (10, 5, 3)


class Head(Protocol):
    """Turns features into distributions over actions."""

    @property
    def linear(self) -> nn.Linear:
        """The head's only layer."""

    def normalized(self, units: Tensor) -> Tensor:
        """Return the parameters of the distributions from that layer's units, `[B, A]`."""

    def __call__(self, features: Tensor) -> Tensor:
        """Return the parameters of one distribution for each row, `[B, F]` -> `[B, A]`."""

    def distribution(self, parameters: Tensor) -> Distribution:
        """Return the distributions with these parameters `[B, A]`."""


class ActorCritic(nn.Module):
    """A policy and a value function of the same observation.

    If `value_trunk` is the same module as `policy_trunk`, it is computed and stored once.
    """

    def __init__(
        self, view: View, policy_trunk: nn.Sequential, value_trunk: nn.Sequential, head: Head, value: nn.Linear
    ) -> None:
        super().__init__()
        self.view = view
        self.policy_trunk = policy_trunk
        self.head = head
        self.value = value
        self.shared = value_trunk is policy_trunk
        self.has_crelu = isinstance(policy_trunk[-1], CReLU)
        if not self.shared:
            self.value_trunk = value_trunk

    def forward(self, observations: Tensor) -> tuple[Tensor, Tensor]:
        """Return the parameters of the action distributions `[B, A]`, and the values `[B]`, of B observations."""
        seen = self.view(observations)
        if self.has_crelu:
            return self._heads_of_one_trunk(seen)
        features = self.policy_trunk(seen)
        value_features = features if self.shared else self.value_trunk(seen)
        return self.head(features), self.value(value_features).squeeze(-1)

    def _heads_of_one_trunk(self, seen: Tensor) -> tuple[Tensor, Tensor]:
        """Compute both heads at once, straight from the responses that the trunk's last rectifier takes."""
        responses, policy, value = self.policy_trunk[:-1](seen), self.head.linear, self.value
        weight, bias = torch.cat((policy.weight, value.weight)), torch.cat((policy.bias, value.bias))
        units = rectified_linear(responses, weight, bias)
        return self.head.normalized(units[:, :-1]), units[:, -1]

    def values(self, observations: Tensor) -> Tensor:
        """Return the values only, `[B]`."""
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
    """Return the network for these spaces of one sub-environment.

    Args:
        observation_space: `Box` of shape (H, W, 3) and dtype uint8 (a grid; 6, 9, ... for several in a stack), images
            (larger ones), or a flat `Box`.
        action_space: `Discrete`, or a flat `Box`.
        generator: Generator of the initial parameters, on the CPU.
        view: What the network sees of an observation.
        mlp_layers: Hidden layers of the MLP for flat observations.
        mlp_units: Width of each.

    Raises:
        ValueError: There is no network for these spaces.
    """
    if grid := grid_shape(observation_space):
        policy_trunk = value_trunk = grid_trunk(*grid, generator)
        features = 2 * GRID_UNITS
    elif image := image_shape(observation_space):
        policy_trunk = value_trunk = image_trunk(image, generator)
        features = NATURE_UNITS
    elif isinstance(observation_space, spaces.Box) and len(observation_space.shape) == 1:
        sizes = observation_space.shape[0], mlp_layers, mlp_units
        policy_trunk, value_trunk = mlp_trunk(*sizes, generator), mlp_trunk(*sizes, generator)
        features = mlp_units
    else:
        raise ValueError(f"observation_space is {observation_space}; it must be {GRIDS}, {IMAGES}, or a flat Box.")
    head = policy_head(features, action_space, generator)
    return ActorCritic(view, policy_trunk, value_trunk, head, linear(features, 1, VALUE_GAIN, generator))


# ---------------------------------------------------------------------------------------------- heads


class CategoricalHead(nn.Module):
    """Log-probabilities of discrete actions."""

    def __init__(self, features: int, actions: int, generator: torch.Generator) -> None:
        super().__init__()
        self.logits = linear(features, actions, POLICY_GAIN, generator)

    @property
    def linear(self) -> nn.Linear:
        """The layer that gives the logits."""
        return self.logits

    def normalized(self, units: Tensor) -> Tensor:
        """Return normalised log-probabilities, from logits `[B, A]`."""
        return units.log_softmax(dim=-1)

    def forward(self, features: Tensor) -> Tensor:
        """Return normalised log-probabilities, `[B, F]` -> `[B, A]`."""
        return self.normalized(self.logits(features))

    def distribution(self, parameters: Tensor) -> Distribution:
        """Return the categorical distributions with these log-probabilities `[B, A]`."""
        return Categorical(parameters)


class GaussianHead(nn.Module):
    """Means of continuous actions, and standard deviations that do not depend on the state and start at 1."""

    def __init__(self, features: int, actions: int, generator: torch.Generator) -> None:
        super().__init__()
        self.mean = linear(features, actions, POLICY_GAIN, generator)
        self.log_std = nn.Parameter(torch.zeros(actions))

    @property
    def linear(self) -> nn.Linear:
        """The layer that gives the means."""
        return self.mean

    def normalized(self, units: Tensor) -> Tensor:
        """Return means `[B, A]` as they are."""
        return units

    def forward(self, features: Tensor) -> Tensor:
        """Return means, `[B, F]` -> `[B, A]`."""
        return self.normalized(self.mean(features))

    def distribution(self, parameters: Tensor) -> Distribution:
        """Return the diagonal Gaussians with these means `[B, A]`."""
        return DiagonalGaussian(parameters, self.log_std)


def policy_head(features: int, action_space: spaces.Space[Any], generator: torch.Generator) -> Head:
    """Return the head for this action space."""
    match action_space:
        case spaces.Discrete(n=count, start=0):
            return CategoricalHead(features, int(count), generator)
        case spaces.Box(shape=(size,)):
            return GaussianHead(features, size, generator)
        case _:
            raise ValueError(f"action_space is {action_space}; it must be Discrete (from 0) or a flat Box.")


# --------------------------------------------------------------------------------------------- trunks

GRID_CHANNELS = (16, 8, 8)
GRID_UNITS = 512


def grid_trunk(height: int, width: int, frames: int, generator: torch.Generator) -> nn.Sequential:
    """Return the grid network of appendix D.3 without its heads, `[B, H, W, 3 * frames]` uint8 -> `[B, 1024]`."""
    convolutions, features = grid_convolutions(height, width, frames, generator)
    return nn.Sequential(*convolutions, linear(features, GRID_UNITS, CRELU_GAIN, generator), CReLU())


def image_trunk(shape: ImageShape, generator: torch.Generator) -> nn.Sequential:
    """Return the network of Mnih et al. (2015) without its heads, images `[B, ...]` uint8 -> `[B, 512]`."""
    convolutions, features = nature_convolutions(shape, generator)
    wide = linear(features, NATURE_UNITS, RELU_GAIN, generator)
    return nn.Sequential(Pixels(shape), *convolutions, wide, nn.ReLU(inplace=True))


class CReLU(nn.Module):
    """Concatenated ReLU (Shang et al. 2016): ReLU of x and of -x, so that one of the two has a gradient."""

    def forward(self, responses: Tensor) -> Tensor:
        """`[B, F]` -> `[B, 2 F]`."""
        return functional.relu(torch.cat((responses, -responses), dim=1), inplace=True)


def grid_convolutions(height: int, width: int, frames: int, generator: torch.Generator) -> tuple[list[nn.Module], int]:
    """Return the scaling of cells and the three convolutions of appendix D.3, and their number of features."""
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
    """Divides each of type, colour and state of a grid cell by its largest value, frame by frame."""

    def __init__(self, frames: int = 1) -> None:
        super().__init__()
        self.channels = len(LARGEST_CODES) * frames
        self.scale: Tensor
        self.register_buffer("scale", 1 / torch.tensor(LARGEST_CODES * frames), persistent=False)

    def forward(self, cells: Tensor) -> Tensor:
        """`[B, H, W, 3 F]` uint8 -> `[B, 3 F, H, W]` float32, in channels-last memory."""
        return (cells * self.scale).permute(0, 3, 1, 2)
