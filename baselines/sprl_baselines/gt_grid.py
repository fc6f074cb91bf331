"""GT-Grid: a bonus for each cell that is new in its episode (Savinov et al. 2019).

It is an oracle: it reads the agent's true position, which other agents do not see. The paper's baseline of this name
(appendix D.3, Table 1).
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


@dataclass(frozen=True)
class GTGridConfig(Config):
    """Hyperparameters of GT-Grid."""

    bonus_weight: Weight = 0.01  # reward for the first visit of a cell in its episode (Table 1)


class GTGrid:
    """Counts first visits in each episode.

    A step earns the bonus for the cell of its true successor, also at the end of an episode. The cell where an
    episode starts counts as visited.

    Args:
        setting: Observations must be square grids.
        config: Hyperparameters.

    Raises:
        ValueError: Observations are not square grids.
    """

    privileged: ClassVar[bool] = True

    def __init__(self, setting: Setting, config: GTGridConfig) -> None:
        self._config = config
        self._side = square_grid_side(setting.observation_space)
        self._visited = np.zeros((setting.num_envs, self._side**2), dtype=np.bool_)

    def reward(self, rollout: Rollout) -> Tensor:
        """Return `bonus_weight` where the true successor's cell is new in the episode, else 0, `[T, N]`."""
        before, after = self._cells(rollout.positions), self._cells(rollout.next_positions)
        ended = rollout.ended.cpu().numpy()
        is_new = np.empty_like(ended)
        env = np.arange(ended.shape[1])
        for step in range(len(ended)):
            self._visited[env, before[step]] = True
            is_new[step] = ~self._visited[env, after[step]]
            self._visited[ended[step]] = False
        return self._config.bonus_weight * torch.from_numpy(is_new).to(rollout.rewards)

    def _cells(self, positions: Tensor) -> npt.NDArray[np.int64]:
        """Number the cells (x, y) of `[T, N, 2]`, `[T, N]`."""
        if positions.shape[-1] != 2:
            raise ValueError(f"positions has the shape {tuple(positions.shape)}; it must be (T, N, 2).")
        x, y = np.moveaxis(positions.cpu().numpy(), -1, 0)
        cells: npt.NDArray[np.int64] = y * self._side + x
        return cells

    def update(self, rollout: Rollout) -> Mapping[str, float]:  # noqa: ARG002 - there is nothing to train
        """Train nothing."""
        return {}

    def state_dict(self) -> Mapping[str, Any]:
        """Return the cells visited in the running episodes."""
        return {"visited": self._visited.copy()}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Restore such cells."""
        self._visited = np.array(state["visited"])
