"""GT-Grid: pays for each cell that is new in its episode, told by the env's true state (Savinov et al. 2019).

An oracle of what is new, as no ordinary agent has it: the paper's baseline of that name (appendix D.3, Table 1).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar

import numpy as np
import numpy.typing as npt
import torch
from gymnasium import Space
from torch import Tensor

from sprl_baselines.bonus import Setting
from sprl_baselines.learning.config import Choice, Config, Weight
from sprl_baselines.learning.grids import SQUARE_GRID, grid_shape
from sprl_baselines.learning.rollout import Rollout
from sprl_bench import solver

Places = npt.NDArray[np.int64]


@dataclass(frozen=True)
class GTGridConfig(Config):
    """Hyperparameters of GT-Grid."""

    bonus_weight: Weight = 0.01  # reward for the first visit of a place in its episode (Table 1)
    # What makes a place: the agent's cell, or with it whether the key is in hand and the door open.
    visit_key: Annotated[str, Choice("position", "state")] = "position"


class GTGrid:
    """First visits, episode by episode.

    A step is paid for the place it leads to, which is the true successor's also where the episode ends. The place
    where an episode starts counts as visited.

    Args:
        setting: Where it works; observations are grids.
        config: Hyperparameters.

    Raises:
        ValueError: Observations are no grids.
    """

    privileged: ClassVar[bool] = True

    def __init__(self, setting: Setting, config: GTGridConfig) -> None:
        self._config = config
        self._size = _size(setting.observation_space)
        places = self._size**2 * (1 if config.visit_key == "position" else 4)
        self._visited = np.zeros((setting.num_envs, places), dtype=np.bool_)

    def reward(self, rollout: Rollout) -> Tensor:
        """Return the weight where the true successor's place is new in the episode, else 0, `[T, N]`."""
        before, after = self._places(rollout)
        ended = rollout.ended.cpu().numpy()
        is_new = np.empty_like(ended)
        env = np.arange(ended.shape[1])
        for step in range(len(ended)):
            self._visited[env, before[step]] = True
            is_new[step] = ~self._visited[env, after[step]]
            self._visited[ended[step]] = False
        return self._config.bonus_weight * torch.from_numpy(is_new).to(rollout.rewards)

    def _places(self, rollout: Rollout) -> tuple[Places, Places]:
        """Number the places before and after each step, both `[T, N]`."""
        if self._config.visit_key == "position":
            return self._cells(rollout.positions), self._cells(rollout.next_positions)
        return _states(rollout.observations), _states(rollout.next_observations)

    def _cells(self, positions: Tensor) -> Places:
        """Number the cells (x, y) of `[T, N, 2]`."""
        if positions.shape[-1] != 2:
            raise ValueError("Hyperparameter visit_key='position' needs an env that reports the agent's position.")
        x, y = np.moveaxis(positions.cpu().numpy(), -1, 0)
        cells: Places = y * self._size + x
        return cells

    def update(self, rollout: Rollout) -> Mapping[str, float]:  # noqa: ARG002 - there is nothing to train
        """Train nothing."""
        return {}

    def state_dict(self) -> Mapping[str, Any]:
        """Return the places visited in the running episodes."""
        return {"visited": self._visited.copy()}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Take such places."""
        self._visited = np.array(state["visited"])


def _size(space: Space[Any]) -> int:
    """Return the number of cells along each side of a grid."""
    match grid_shape(space):
        case (height, width, 1) if height == width:
            return height
        case _:
            raise ValueError(f"GT-Grid has no cells to count in observations in {space}: need {SQUARE_GRID}.")


def _states(observations: Tensor) -> Places:
    """Number the states (cell, key in hand, door open) that `[T, N, S, S, 3]` show."""
    size = observations.shape[2]
    state = solver.parse(observations.flatten(0, 1).cpu().numpy())
    in_hand, is_open = state.key == size**2, state.door_state == 0
    places: Places = (state.agent * 2 + in_hand) * 2 + is_open
    return places.reshape(observations.shape[:2])
