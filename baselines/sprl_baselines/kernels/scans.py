"""Sums that run through the steps of a rollout, compiled: as PyTorch's operations they would be a call a step."""

from __future__ import annotations

from typing import Any

import torch
from numpy.typing import NDArray
from torch import Tensor

from sprl_baselines.kernels.compiling import kernel


def sums_backward(values: Tensor, carry: Tensor) -> Tensor:
    """Return `sums[t] = values[t] + carry[t] * sums[t + 1]`, `[T, N]`; nothing follows the last step."""
    sums = values.detach().cpu().numpy().copy()
    _run_backward(sums, _array(carry))
    return torch.from_numpy(sums).to(values.device)


def sums_forward(values: Tensor, carry: Tensor, first: Tensor) -> Tensor:
    """Return `sums[t] = values[t] + carry[t] * sums[t - 1]`, `[T, N]`, where `first` `[N]` is before the first step."""
    sums = values.detach().cpu().numpy().copy()
    _run_forward(sums, _array(carry), _array(first))
    return torch.from_numpy(sums).to(values.device)


def _array(tensor: Tensor) -> NDArray[Any]:
    return tensor.detach().contiguous().cpu().numpy()


@kernel
def _run_backward(sums: NDArray[Any], carry: NDArray[Any]) -> None:
    for step in range(len(sums) - 2, -1, -1):
        for env in range(sums.shape[1]):
            sums[step, env] += carry[step, env] * sums[step + 1, env]


@kernel
def _run_forward(sums: NDArray[Any], carry: NDArray[Any], first: NDArray[Any]) -> None:
    before = first
    for step in range(len(sums)):
        for env in range(sums.shape[1]):
            sums[step, env] += carry[step, env] * before[env]
        before = sums[step]
