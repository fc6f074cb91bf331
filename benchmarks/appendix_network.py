"""The grid network of appendix D.3 in its plainest form, for the peers' learners: in torch and in flax.

Stable-Baselines3 and SBX hand over images with their channels first.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import gymnasium
import torch
from torch import nn
from torch.nn import functional

from sprl_baselines.learning.networks import LARGEST_CODES

# The network at 7x7: three convolutions with a 2x2 kernel, then the wide layer, each with a concatenated rectifier.
CELLS, UNITS = 7 * 7, 512
CONVOLUTIONS = ((3, 16), (32, 8), (16, 8))  # channels in and out


def torch_network() -> type[Any]:
    """Return it as a features extractor of Stable-Baselines3."""
    from stable_baselines3.common.torch_layers import BaseFeaturesExtractor  # noqa: PLC0415 - optional

    class AppendixNetwork(BaseFeaturesExtractor):  # type: ignore[misc,unused-ignore]  # untyped where it is not installed
        def __init__(self, space: gymnasium.spaces.Box) -> None:
            super().__init__(space, 2 * UNITS)
            self.scale = nn.Parameter(torch.tensor(LARGEST_CODES).view(1, 3, 1, 1).float(), requires_grad=False)
            self.convolutions = nn.ModuleList(nn.Conv2d(*pair, 2) for pair in CONVOLUTIONS)
            self.wide = nn.Linear(CELLS * 16, UNITS)

        def forward(self, images: torch.Tensor) -> torch.Tensor:
            """`[B, 3, 7, 7]` -> `[B, 1024]`."""
            images = images / self.scale
            for convolution in self.convolutions:
                images = convolution(functional.pad(images, (0, 1, 0, 1)))
                images = torch.relu(torch.cat((images, -images), dim=1))
            responses = self.wide(images.flatten(1))
            return torch.relu(torch.cat((responses, -responses), dim=1))

    return AppendixNetwork


def flax_network() -> type[Any]:
    """Return it as a features extractor of SBX."""
    import flax.linen  # noqa: PLC0415 - optional
    import jax.numpy as jnp  # noqa: PLC0415 - optional

    def rectified(responses: Any) -> Any:
        return flax.linen.relu(jnp.concatenate((responses, -responses), axis=-1))

    class AppendixNetwork(flax.linen.Module):  # type: ignore[misc]  # flax is treated as untyped
        features_dim: int  # SBX passes its own number, and an activation; both are the appendix's here
        activation_fn: Callable[[Any], Any]

        @flax.linen.compact  # type: ignore[untyped-decorator]
        def __call__(self, images: Any) -> Any:
            """`[B, 3, 7, 7]` -> `[B, 1024]`."""
            images = jnp.transpose(images, (0, 2, 3, 1)) / jnp.array(LARGEST_CODES, jnp.float32)
            for _, channels in CONVOLUTIONS:
                images = rectified(flax.linen.Conv(channels, (2, 2), padding=((0, 1), (0, 1)))(images))
            return rectified(flax.linen.Dense(UNITS)(images.reshape(len(images), -1)))

    return AppendixNetwork
