"""GT-Grid: a bonus for each cell that is new in its episode (Savinov et al. 2019).

It is an oracle: it reads the agent's true position, which other agents do not see. The paper's baseline of this name
(appendix D.3, Table 1). On the grids a cell is a cell. On Fetch, where the paper has no GT-Grid, a cell is a cube of
space: the one that the gripper is in, together with the one that the object is in. In mazes a cell is a square of 30
units, as in Savinov et al.'s code.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt
import torch
from gymnasium import Space, spaces
from torch import Tensor

from sprl_baselines.bonus import Setting
from sprl_baselines.learning.config import Config, Positive, Weight
from sprl_baselines.learning.grids import square_grid_side
from sprl_baselines.learning.images import image_shape
from sprl_baselines.learning.rollout import Rollout

FETCH = {16: 3, 31: 6}  # by length of a flat observation: its first coordinates are the gripper's and the object's
CUBES = 1024  # an axis, centred at the origin; the arm reaches 1.6 m

Cells = npt.NDArray[np.int64]  # [T, N], a number for each cell


@dataclass(frozen=True)
class GTGridConfig(Config):
    """Hyperparameters of GT-Grid."""

    bonus_weight: Weight = 0.01  # reward for the first visit of a cell in its episode (Table 1)
    cube_size: Positive = 0.05  # edge of a cell: metres on Fetch (ours: the goal's tolerance), units in mazes


class GTGrid:
    """Counts first visits in each episode.

    A step earns the bonus for the cell of its true successor, also at the end of an episode. The cell where an
    episode starts counts as visited.

    Args:
        setting: Observations must be square grids, Fetch's flat ones, or images of an env that reports positions.
        config: Hyperparameters.

    Raises:
        ValueError: Observations are none of these.
    """

    privileged: ClassVar[bool] = True

    def __init__(self, setting: Setting, config: GTGridConfig) -> None:
        self._config = config
        self._cells = _cells_of(setting.observation_space, config.cube_size)
        self._visited: list[set[int]] = [set() for _ in range(setting.num_envs)]

    def reward(self, rollout: Rollout) -> Tensor:
        """Return `bonus_weight` where the true successor's cell is new in the episode, else 0, `[T, N]`."""
        before, after = self._cells(rollout)
        rows = zip(before.tolist(), after.tolist(), rollout.ended.tolist(), strict=True)
        is_new = [list(map(self._step, self._visited, *row)) for row in rows]
        return self._config.bonus_weight * torch.tensor(is_new).to(rollout.rewards).view_as(rollout.rewards)

    @staticmethod
    def _step(visited: set[int], before: int, after: int, ended: bool) -> bool:
        """Walk from one cell to the next, and return whether the next one is new."""
        visited.add(before)
        is_new = after not in visited
        if ended:
            visited.clear()
        return is_new

    def update(self, rollout: Rollout) -> Mapping[str, float]:  # noqa: ARG002 - there is nothing to train
        """Train nothing."""
        return {}

    def state_dict(self) -> Mapping[str, Any]:
        """Return the cells visited in the running episodes, and how many they are in each sub-env."""
        cells = [cell for visited in self._visited for cell in sorted(visited)]
        return {"cells": np.array(cells, np.int64), "counts": np.array([len(visited) for visited in self._visited])}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Restore such cells."""
        parts = np.split(np.asarray(state["cells"]), np.cumsum(state["counts"])[:-1])
        self._visited = [set(part.tolist()) for part in parts]


def _cells_of(space: Space[Any], cube_size: float) -> Callable[[Rollout], tuple[Cells, Cells]]:
    """Return what numbers the cells before and after each step of a rollout."""
    match space:
        case spaces.Box(shape=(length,), dtype=np.float64) if length in FETCH:
            return partial(_cubes, coordinates=FETCH[length], size=cube_size)
        case _ if image_shape(space):
            return partial(_places, size=cube_size)
        case _:
            return partial(_squares, side=square_grid_side(space))


def _squares(rollout: Rollout, side: int) -> tuple[Cells, Cells]:
    def numbers(positions: Tensor) -> Cells:
        if positions.shape[-1] != 2:
            raise ValueError(f"positions has the shape {tuple(positions.shape)}; it must be (T, N, 2).")
        x, y = np.moveaxis(positions.cpu().numpy(), -1, 0)
        cells: Cells = y * side + x
        return cells

    return numbers(rollout.positions), numbers(rollout.next_positions)


def _cubes(rollout: Rollout, coordinates: int, size: float) -> tuple[Cells, Cells]:
    def numbers(observations: Tensor) -> Cells:
        return _numbered(observations[..., :coordinates].cpu().numpy(), size)

    return numbers(rollout.observations), numbers(rollout.next_observations)


def _places(rollout: Rollout, size: float) -> tuple[Cells, Cells]:
    def numbers(positions: Tensor) -> Cells:
        if not positions.shape[-1]:
            raise ValueError("info has no 'position'; it must have one for gt-grid on images.")
        return _numbered(positions.cpu().numpy(), size)

    return numbers(rollout.positions), numbers(rollout.next_positions)


def _numbered(coordinates: npt.NDArray[Any], size: float) -> Cells:
    """Number the cubes of coordinates `[T, N, D]`."""
    cubes = np.floor(coordinates / size).clip(-CUBES // 2, CUBES // 2 - 1)
    cells: Cells = (cubes.astype(np.int64) + CUBES // 2) @ CUBES ** np.arange(coordinates.shape[-1])
    return cells
