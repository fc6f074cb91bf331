"""What an exploration method adds to PPO: a bonus for each step, and how its own model learns."""

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

    One stream of steps gives the same rewards however it is cut into rollouts: what a bonus remembers of an
    episode lives from one rollout to the next, and ends with the episode.
    """

    @property
    def privileged(self) -> bool:
        """Whether it sees what an ordinary agent does not."""
        ...

    def reward(self, rollout: Rollout) -> Tensor:
        """Return the bonus of each step, already scaled and maybe negative, `[T, N]`.

        It may advance what is remembered of the episodes; it trains nothing and writes nothing to the rollout.
        """
        ...

    def update(self, rollout: Rollout) -> Mapping[str, float]:
        """Train the bonus's own model, if any, and return metrics."""
        ...

    def state_dict(self) -> Mapping[str, Any]:
        """Return all that later rewards depend on: nested mappings of tensors, arrays, numbers and strings."""
        ...

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Take such a state."""
        ...


@dataclass(frozen=True)
class Setting:
    """Where a bonus has to work."""

    observation_space: Space[Any]  # of one sub-env
    action_space: Space[Any]  # of one sub-env
    num_envs: int
    seed: int
    device: torch.device
    view: View = RAW  # what networks see of an observation


@dataclass(frozen=True)
class NoBonusConfig(Config):
    """No hyperparameters."""


class NoBonus:
    """Nothing added: plain PPO."""

    privileged: ClassVar[bool] = False

    def __init__(self, setting: Setting, config: NoBonusConfig) -> None:
        """Ignore both, as there is nothing to build."""

    def reward(self, rollout: Rollout) -> Tensor:
        """Return zeros, `[T, N]`."""
        return torch.zeros_like(rollout.rewards)

    def update(self, rollout: Rollout) -> Mapping[str, float]:  # noqa: ARG002 - there is nothing to train
        """Train nothing."""
        return {}

    def state_dict(self) -> Mapping[str, Any]:
        """Return nothing, as nothing is remembered."""
        return {}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Take nothing."""
