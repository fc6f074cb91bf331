"""What an exploration method adds to PPO: a bonus for each step, and the training of its own model."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Protocol

import torch
from gymnasium import Space
from torch import Tensor

from sprl_baselines.learning.config import Config
from sprl_baselines.learning.observations import RAW, View
from sprl_baselines.learning.rollout import Rollout


class Bonus(Protocol):
    """An intrinsic reward.

    The rewards of a stream of steps do not depend on how the stream is cut into rollouts: episodic memory is kept
    from one rollout to the next, and is cleared when the episode ends.
    """

    @property
    def privileged(self) -> bool:
        """Whether the bonus uses more than observations and rewards, such as the true state."""
        ...

    def reward(self, rollout: Rollout) -> Tensor:
        """Return the bonus of each step, `[T, N]`, already scaled; it may be negative.

        This may update episodic memory. It trains nothing and never writes to the rollout.
        """
        ...

    def update(self, rollout: Rollout) -> Mapping[str, float]:
        """Train the bonus's own model, if any, and return metrics."""
        ...

    def state_dict(self) -> Mapping[str, Any]:
        """Return everything that later rewards depend on: nested mappings of tensors, arrays, numbers and strings."""
        ...

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Restore such a state."""
        ...


@dataclass(frozen=True)
class Setting:
    """The environment, seed and device that a bonus is made for."""

    observation_space: Space[Any]  # of one sub-env
    action_space: Space[Any]  # of one sub-env
    num_envs: int
    seed: int
    device: torch.device
    view: View = RAW  # what networks see of an observation
    action_time: float = 1.0  # duration of an env step, in reference actions


@dataclass(frozen=True)
class NoBonusConfig(Config):
    """No hyperparameters."""


class NoBonus:
    """No bonus: plain PPO."""

    privileged: ClassVar[bool] = False

    def __init__(self, setting: Setting, config: NoBonusConfig) -> None:
        """Ignore both arguments: there is nothing to build."""

    def reward(self, rollout: Rollout) -> Tensor:
        """Return zeros, `[T, N]`."""
        return torch.zeros_like(rollout.rewards)

    def update(self, rollout: Rollout) -> Mapping[str, float]:  # noqa: ARG002 - there is nothing to train
        """Train nothing."""
        return {}

    def state_dict(self) -> Mapping[str, Any]:
        """Return an empty state."""
        return {}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Restore nothing."""
