"""Generalised advantage estimation (Schulman et al. 2016)."""

from __future__ import annotations

import torch
from torch import Tensor

from sprl_baselines.kernels.scans import sums_backward


def generalized_advantages(
    rewards: Tensor,
    values: Tensor,
    next_values: Tensor,
    terminated: Tensor,
    truncated: Tensor,
    *,
    gamma: float,
    gae_lambda: float,
    bootstrap_on_truncation: bool = False,
) -> Tensor:
    """Return advantage estimates, `[T, N]` (equation 16).

    The sum over later steps stops at both kinds of endings. The successor of a termination has value 0; the successor
    of a truncation has value 0 too, unless `bootstrap_on_truncation` is set.

    Args:
        rewards: Rewards to learn from, `[T, N]`.
        values: Values of the observations, `[T, N]`.
        next_values: Values of the true successors, `[T, N]`.
        terminated: Whether the task ended with this step, `[T, N]` bool.
        truncated: Whether a time limit ended the episode with this step, `[T, N]` bool.
        gamma: Discount per env step.
        gae_lambda: 0 for one-step errors, 1 for full returns.
        bootstrap_on_truncation: False treats truncation as termination, as the paper does (appendix D.1). True uses
            the value of the successor.
    """
    ended = terminated | truncated
    valueless = terminated if bootstrap_on_truncation else ended
    errors = rewards + gamma * next_values.masked_fill(valueless, 0.0) - values
    carry = (gamma * gae_lambda) * (~ended).to(errors.dtype)
    return sums_backward(errors, carry)


def successor_values(values: Tensor, last_values: Tensor, ended: Tensor, final_values: Tensor) -> Tensor:
    """Return the values of the true successors, `[T, N]`.

    Args:
        values: Values of the observations, `[T, N]`.
        last_values: Values of the observations after the last step, `[N]`.
        ended: Whether an episode ended with this step, `[T, N]` bool.
        final_values: Values of the E observations that ended an episode, `[E]`, step by step, sub-env by sub-env.
    """
    following = torch.cat((values[1:], last_values.unsqueeze(0)))
    following[ended] = final_values
    return following
