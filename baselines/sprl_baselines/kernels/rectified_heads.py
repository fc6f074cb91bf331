"""A linear layer behind concatenated rectifiers, for a few units: what heads are to the grid network's wide layer."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from torch import Tensor
from torch.autograd.function import once_differentiable
from torch.nn import functional

from sprl_baselines.kernels import rectified_heads_loops
from sprl_baselines.kernels.compiling import Array
from sprl_baselines.kernels.vectors import LANES


def rectified_linear(responses: Tensor, weight: Tensor, bias: Tensor) -> Tensor:
    """Responses `[B, F]`, weights `[U, 2 F]` and biases `[U]` -> `relu([x, -x]) @ weight.T + bias`, `[B, U]`."""
    if responses.shape[1] % LANES or not all(map(_is_compiled_for, (responses, weight, bias))):
        return functional.linear(torch.cat((responses, -responses), dim=1).relu(), weight, bias)
    if spare := -len(weight) % LANES:
        filled = functional.pad(weight, (0, 0, 0, spare)), functional.pad(bias, (0, spare))
        return rectified_linear(responses, *filled)[:, : len(weight)]
    units: Tensor = _Compiled.apply(responses, weight, bias)  # type: ignore[no-untyped-call] # torch has no types there
    return units


def _is_compiled_for(tensor: Tensor) -> bool:
    return tensor.device.type == "cpu" and tensor.dtype == torch.float32


class _Compiled(torch.autograd.Function):
    """The compiled functions, as PyTorch calls them, for whole tiles of units."""

    @staticmethod
    def forward(ctx: Any, responses: Tensor, weight: Tensor, bias: Tensor) -> Tensor:
        """Responses `[B, F]`, weights `[U, 2 F]`, biases `[U]` -> units `[B, U]`."""
        ctx.save_for_backward(responses, weight)
        units = np.empty((len(responses), len(weight)), np.float32)
        rectified_heads_loops.forward(_array(responses), _array(weight), _array(bias), units)
        return torch.from_numpy(units)

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """From the gradient of the units, those of responses, weights and biases."""
        responses, weight = map(_array, ctx.saved_tensors)
        back, sums = np.empty_like(responses), np.zeros_like(weight)
        rectified_heads_loops.backward(responses, weight, _array(gradient), back, sums)
        return torch.from_numpy(back), torch.from_numpy(sums), gradient.sum(dim=0)


def _array(tensor: Tensor) -> Array:
    return tensor.detach().contiguous().numpy()
