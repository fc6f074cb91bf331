"""Advantages: what an action was worth beyond the value of its state (generalised advantage estimation)."""

from __future__ import annotations

import torch
from torch import Tensor


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
    """Generalised advantage estimates, `[T, N]` (Schulman et al. 2016, equation 16).

    The sum over later steps stops at both kinds of ending. They differ in the last step's own error: after a
    termination nothing follows; after a truncation the successor still has a value, which counts only on request.

    Args:
        rewards: rewards to learn from, `[T, N]`.
        values: value of the observation acted on, `[T, N]`.
        next_values: value of each transition's true successor, `[T, N]`; not used where nothing follows.
        terminated: whether the task ended with this transition, `[T, N]` bool.
        truncated: whether a time limit cut the episode after this transition, `[T, N]` bool.
        gamma: discount per env step.
        gae_lambda: 0 for one-step errors, 1 for whole returns.
        bootstrap_on_truncation: False treats a cut episode as ended, as the paper does (appendix D.1);
            True values what would have followed.
    """
    ended = terminated | truncated
    valueless = terminated if bootstrap_on_truncation else ended
    errors = rewards + gamma * next_values.masked_fill(valueless, 0.0) - values
    carry = (gamma * gae_lambda) * (~ended).to(errors.dtype)
    advantages = errors  # filled from the last step backwards, in place
    for step in range(len(errors) - 2, -1, -1):
        advantages[step].addcmul_(carry[step], advantages[step + 1])
    return advantages


def successor_values(values: Tensor, last_values: Tensor, ended: Tensor, final_values: Tensor) -> Tensor:
    """Value of each transition's true successor, `[T, N]`.

    Args:
        values: value of the observation acted on, `[T, N]`.
        last_values: value of the observations after the last step, `[N]`.
        ended: whether an episode ended with this transition, `[T, N]` bool.
        final_values: values of the E observations that ended an episode, `[E]`, step by step, sub-env by sub-env.
    """
    following = torch.cat((values[1:], last_values.unsqueeze(0)))
    following[ended] = final_values
    return following
