"""The convolution of ICM's encoder for grids: it halves the sides of small images."""

from __future__ import annotations

from math import ceil, prod

import torch
from torch import Tensor, nn
from torch.nn import functional

CHANNELS = 32


class StridedConvolution(nn.Module):
    """A 3x3 convolution of stride 2 with zero padding: half of the cells along each side remain, rounded up.

    On a CPU it is one matrix product on gathered cells. Forward and backward together, ICM's four layers on 600 images
    of 7x7 then take less than half the time of PyTorch's convolutions (one thread of an AMD EPYC).

    Args:
        inputs: Channels C of an image.
        sides: Height H and width W of an image.
        gain: Gain of the orthogonal weights.
        generator: Generator of the weights, on the CPU.
    """

    def __init__(self, inputs: int, sides: tuple[int, int], gain: float, generator: torch.Generator) -> None:
        super().__init__()
        self.weight = nn.Parameter(torch.empty(CHANNELS, inputs, 3, 3))
        self.bias = nn.Parameter(torch.zeros(CHANNELS))
        nn.init.orthogonal_(self.weight, gain, generator)
        self.sides = sides
        self.remaining = ceil(sides[0] / 2), ceil(sides[1] / 2)
        cells = functional.pad(torch.arange(prod(sides)).view(sides), (1, 1, 1, 1), value=prod(sides))
        self.taps: Tensor  # [9 * output cells] input cell of each tap; padding is one more cell at the end
        self.register_buffer("taps", cells.unfold(0, 3, 2).unfold(1, 3, 2).flatten(), persistent=False)

    def forward(self, images: Tensor) -> Tensor:
        """Convolve `[B, C, H, W]` -> `[B, 32, ceil(H / 2), ceil(W / 2)]`, channels-last in memory.

        Raises:
            ValueError: The images have other sides.
        """
        if images.shape[2:] != self.sides:
            raise ValueError(f"Sides of images is {tuple(images.shape[2:])}; it must be {self.sides}.")
        if images.device.type != "cpu":
            return functional.conv2d(images, self.weight, self.bias, stride=2, padding=1)
        cells = functional.pad(images.permute(0, 2, 3, 1).flatten(1, 2), (0, 0, 0, 1))
        windows = cells.index_select(1, self.taps).view(len(images), *self.remaining, self.weight[0].numel())
        responses = functional.linear(windows, self.weight.permute(0, 2, 3, 1).flatten(1), self.bias)
        return responses.permute(0, 3, 1, 2)
