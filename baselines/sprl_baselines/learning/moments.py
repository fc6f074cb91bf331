"""Rewards divided by the running standard deviation of their discounted sum (appendix G.3).

The sum runs forward in each episode, as in Burda et al. (2018): it holds a step's reward and all earlier ones of the
episode, each discounted by its age. No mean is subtracted, so a reward keeps its sign and zero stays zero.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import torch
from torch import Tensor

from sprl_baselines.kernels.scans import sums_forward


class RunningVariance:
    """The population variance of all values seen so far, updated batch by batch (Chan et al. 1983)."""

    def __init__(self) -> None:
        self.count, self.mean, self._squares = 0, 0.0, 0.0  # `_squares`: summed squared distances from the mean

    def update(self, values: Tensor) -> None:
        """Add values, of any shape."""
        values = values.double()
        count, mean = values.numel(), float(values.mean())
        total, distance = self.count + count, mean - self.mean
        self._squares += float((values - mean).square().sum()) + distance**2 * self.count * count / total
        self.mean += distance * count / total
        self.count = total

    @property
    def variance(self) -> float:
        """The variance of all values so far; 0 before the first."""
        return self._squares / max(self.count, 1)

    def state_dict(self) -> dict[str, Any]:
        """Return the three numbers."""
        return {"count": self.count, "mean": self.mean, "squares": self._squares}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Restore such numbers."""
        self.count, self.mean, self._squares = int(state["count"]), float(state["mean"]), float(state["squares"])


class RewardNormalizer:
    """Scales rewards so that their discounted sums have unit standard deviation.

    Args:
        num_envs: Sub-envs N, each with its own running sum.
        gamma: Discount per env step.
        device: Device of the rewards.
        clip: Largest absolute value of a scaled reward; 0 for no limit.
    """

    def __init__(self, num_envs: int, gamma: float, device: torch.device, clip: float = 0.0) -> None:
        self._gamma, self._clip = gamma, clip or torch.inf
        self._sums = torch.zeros(num_envs, dtype=torch.float64, device=device)
        self._moments = RunningVariance()

    @property
    def deviation(self) -> float:
        """The divisor of rewards: the standard deviation of the sums, or 1 while all sums were equal."""
        return self._moments.variance**0.5 or 1.0

    def __call__(self, rewards: Tensor, ended: Tensor) -> Tensor:
        """Add a rollout's rewards to the statistics, then return them scaled.

        Args:
            rewards: `[T, N]`.
            ended: Whether an episode ended with this step, `[T, N]` bool. The next step starts a new sum.
        """
        self._moments.update(self._discounted_sums(rewards.double(), ended))
        return (rewards / self.deviation).clamp(-self._clip, self._clip)

    def _discounted_sums(self, rewards: Tensor, ended: Tensor) -> Tensor:
        """Return each step's discounted sum of rewards so far in its episode, `[T, N]`."""
        follows = torch.cat((torch.ones_like(ended[:1]), ~ended[:-1]))  # whether the step before is of the same episode
        sums = sums_forward(rewards, self._gamma * follows.double(), self._sums)
        self._sums = sums[-1].masked_fill(ended[-1], 0.0)
        return sums

    def state_dict(self) -> dict[str, Any]:
        """Return the running sums and the moments."""
        return {"sums": self._sums.clone(), "moments": self._moments.state_dict()}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Restore such a state."""
        self._sums = state["sums"].to(self._sums.device)
        self._moments.load_state_dict(state["moments"])
