"""Count: pays for states that the run has rarely visited, from the true state (Strehl and Littman 2008).

The bonus is bonus_weight / sqrt(n + 1), where n is how often the successor's state was visited in earlier rollouts. A
state is what the agent can change: its cell and direction, the key in hand or not, the door open or not.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor

from sprl_baselines.bonus import Setting
from sprl_baselines.learning.config import Config, Weight
from sprl_baselines.learning.grids import square_grid_side
from sprl_baselines.learning.rollout import Rollout
from sprl_bench import solver


@dataclass(frozen=True)
class CountConfig(Config):
    """Hyperparameters of Count."""

    bonus_weight: Weight = 0.01  # reward for a state that was never visited (our choice; not in the paper)


class Count:
    """Lifetime visits. The counts change once a rollout, as the model of every other bonus does.

    Args:
        setting: Where it works; observations are grids.
        config: Hyperparameters.

    Raises:
        ValueError: Observations are no grids.
    """

    privileged: ClassVar[bool] = True

    def __init__(self, setting: Setting, config: CountConfig) -> None:
        self._config = config
        side = square_grid_side(setting.observation_space)
        self.visits = np.zeros(side**2 * 4 * 2 * 2, np.int64)  # by cell, direction, key in hand, door open

    def reward(self, rollout: Rollout) -> Tensor:
        """Return bonus_weight / sqrt(n + 1) for each step's true successor, `[T, N]`."""
        visits = torch.from_numpy(self.visits[_numbers(rollout)]).to(rollout.rewards)
        return self._config.bonus_weight / (visits + 1).sqrt().view_as(rollout.rewards)

    def update(self, rollout: Rollout) -> Mapping[str, float]:
        """Count the visits of a rollout, and return how many states have been visited."""
        self.visits += np.bincount(_numbers(rollout), minlength=len(self.visits))
        return {"visited_states": float(np.count_nonzero(self.visits))}

    def state_dict(self) -> Mapping[str, Any]:
        """Return the counts."""
        return {"visits": self.visits.copy()}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Take such counts."""
        self.visits = np.array(state["visits"])


def _numbers(rollout: Rollout) -> npt.NDArray[np.int64]:
    """Number the states of all true successors, `[T * N]`."""
    grids = rollout.next_observations.flatten(0, 1).cpu().numpy()
    state = solver.parse(grids)
    in_hand, is_open = state.key == grids.shape[1] ** 2, state.door_state == 0
    numbers: npt.NDArray[np.int64] = ((state.agent * 4 + state.direction) * 2 + in_hand) * 2 + is_open
    return numbers
