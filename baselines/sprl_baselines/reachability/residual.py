"""The residual network that embeds an image for the reachability network (appendix E.4; He et al. 2016).

The paper has 2-2-1 blocks for SPRL and 2-2-2-2 for ECO, and 512 units behind them. The widths, 32 and 64 channels in
the first blocks and twice as many in each following group, are those of the authors' and of Savinov et al.'s code.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn

from sprl_baselines.learning.images import ImageShape, Pixels
from sprl_baselines.learning.initialization import RELU_GAIN, convolution, linear
from sprl_baselines.learning.observations import View

SMALL = (2, 2, 1)
"""Blocks of SPRL's network."""
LARGE = (2, 2, 2, 2)
"""Blocks of ECO's network."""
WIDTHS = {SMALL: 32, LARGE: 64}  # channels of the first group


class ResidualBlock(nn.Module):
    """Two 3x3 convolutions whose result is added to their input.

    Args:
        inputs: Channels of the input.
        outputs: Channels of the result.
        stride: 2 to halve the sides; the input is then projected by a 1x1 convolution.
        generator: Generator of the initial parameters, on the CPU.
    """

    def __init__(self, inputs: int, outputs: int, stride: int, generator: torch.Generator) -> None:
        super().__init__()
        self.body = nn.Sequential(
            convolution(inputs, outputs, 3, stride, generator, padding=1),
            nn.BatchNorm2d(outputs),
            nn.ReLU(inplace=True),
            convolution(outputs, outputs, 3, 1, generator, padding=1),
            nn.BatchNorm2d(outputs),
        )
        same = inputs == outputs and stride == 1
        self.shortcut = nn.Identity() if same else convolution(inputs, outputs, 1, stride, generator)

    def forward(self, images: Tensor) -> Tensor:
        """`[B, inputs, H, W]` -> `[B, outputs, H / stride, W / stride]`."""
        total: Tensor = self.body(images) + self.shortcut(images)
        return total.relu()


def residual_embedding(
    shape: ImageShape, view: View, units: int, blocks: tuple[int, ...], generator: torch.Generator
) -> nn.Sequential:
    """Return the network that embeds images of this shape, `[B, ...]` -> `[B, units]`.

    Args:
        shape: Of the images.
        view: What it sees of an observation.
        units: Features of an embedding.
        blocks: Blocks in each group, `SMALL` or `LARGE`.
        generator: Generator of the initial parameters, on the CPU.
    """
    width = WIDTHS[blocks]
    stem = convolution(shape.channels, width, 7, 2, generator, padding=3)
    layers: list[nn.Module] = [stem, nn.BatchNorm2d(width), nn.ReLU(inplace=True), nn.MaxPool2d(3, 2, 1)]
    inputs = width
    for group, count in enumerate(blocks):
        outputs = width * 2**group
        for block in range(count):
            stride = 2 if group and not block else 1
            layers.append(ResidualBlock(inputs, outputs, stride, generator))
            inputs = outputs
    flat = [nn.AdaptiveAvgPool2d(1), nn.Flatten(), linear(inputs, units, RELU_GAIN, generator)]
    return nn.Sequential(view, Pixels(shape), *layers, *flat, nn.BatchNorm1d(units), nn.ReLU(inplace=True))
