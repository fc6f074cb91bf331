"""Images: how they are recognised, and the convolutional networks for them.

The policy and the value function share the network of Mnih et al. (2015) (appendices E.4 and F.4).
"""

from __future__ import annotations

from itertools import pairwise
from math import prod
from typing import Any, NamedTuple

import numpy as np
import torch
from gymnasium import Space, spaces
from torch import Tensor, nn

from sprl_baselines.learning.grids import grid_shape
from sprl_baselines.learning.initialization import convolution

SMALLEST = 36  # pixels along a side: what the three convolutions need
IMAGES = f"images, uint8 (H, W, C) or (C, H, W) with at least {SMALLEST} pixels along each side"
BRIGHTEST = 255
NATURE_UNITS = 512
NATURE = ((32, 8, 4), (64, 4, 2), (64, 3, 1))  # channels, side of the kernel, stride


class ImageShape(NamedTuple):
    """The shape of image observations."""

    channels: int
    height: int
    width: int
    channels_first: bool


def image_shape(space: Space[Any]) -> ImageShape | None:
    """Return the shape of image observations; None for other observations. The shortest axis is that of channels."""
    if not isinstance(space, spaces.Box) or space.dtype != np.uint8 or len(space.shape) != 3 or grid_shape(space):
        return None
    first, middle, last = space.shape
    shape = ImageShape(first, middle, last, True) if first < last else ImageShape(last, first, middle, False)
    return shape if min(shape.height, shape.width) >= SMALLEST else None


class Pixels(nn.Module):
    """Divides pixels by 255 and puts channels first, in channels-last memory: convolutions are faster there.

    Args:
        shape: Of the images.
    """

    def __init__(self, shape: ImageShape) -> None:
        super().__init__()
        self.channels, self._channels_first = shape.channels, shape.channels_first

    def forward(self, images: Tensor) -> Tensor:
        """`[B, H, W, C]` or `[B, C, H, W]`, uint8 or differences of such -> `[B, C, H, W]` float32."""
        scaled = images.float() / BRIGHTEST
        ordered = scaled if self._channels_first else scaled.permute(0, 3, 1, 2)
        return ordered.contiguous(memory_format=torch.channels_last)


def nature_convolutions(shape: ImageShape, generator: torch.Generator) -> tuple[list[nn.Module], int]:
    """Return the three convolutions of Mnih et al. (2015) with their ReLUs, flattened, and their number of features.

    Their input is `[B, C, H, W]`.
    """
    sides = shape.height, shape.width
    layers: list[nn.Module] = []
    for inputs, (outputs, side, stride) in zip((shape.channels, 32, 64), NATURE, strict=True):
        layers += [convolution(inputs, outputs, side, stride, generator), nn.ReLU(inplace=True)]
        sides = (sides[0] - side) // stride + 1, (sides[1] - side) // stride + 1
    return [*layers, nn.Flatten()], NATURE[-1][0] * prod(sides)


def halving_convolutions(
    channels: int, sides: tuple[int, int], generator: torch.Generator
) -> tuple[list[nn.Module], int]:
    """Return four convolutions of 32 channels and stride 2 with ELUs, flattened, and their number of features.

    They are ICM's (Pathak et al. 2017). Their input is `[B, channels, *sides]`.
    """
    layers: list[nn.Module] = []
    for inputs, outputs in pairwise((channels, 32, 32, 32, 32)):
        layers += [convolution(inputs, outputs, 3, 2, generator, padding=1), nn.ELU()]
        sides = (sides[0] + 1) // 2, (sides[1] + 1) // 2
    return [*layers, nn.Flatten()], 32 * prod(sides)


class Shrunk(nn.Module):
    """Resizes images by averaging.

    Args:
        side: Pixels along each side of the result.
    """

    def __init__(self, side: int) -> None:
        super().__init__()
        self._side = side

    def forward(self, images: Tensor) -> Tensor:
        """`[B, C, H, W]` -> `[B, C, side, side]`."""
        return nn.functional.adaptive_avg_pool2d(images, self._side)
