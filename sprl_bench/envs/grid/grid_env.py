"""One grid environment on Minigrid, with the whole grid as its observation.

Dynamics and rendering are Minigrid's. This class adds the observation, the information, the end of an episode, and the
check of an action before anything changes.
"""

from __future__ import annotations

from abc import abstractmethod
from typing import Any, ClassVar

import numpy as np
from minigrid.core.grid import Grid
from minigrid.core.mission import MissionSpace
from minigrid.core.world_object import Key
from minigrid.minigrid_env import MiniGridEnv
from numpy.typing import NDArray

from sprl_bench.envs.checks import check_choice, check_integer, refuse_unknown
from sprl_bench.envs.grid.encoding import AGENT, EMPTY, HORIZON, NUM_ACTIONS, RED
from sprl_bench.envs.grid.observations import CELLS, FORMS, shown, space_of

_EMPTY_CELL = bytes((EMPTY, 0, 0))


class GridEnv(MiniGridEnv):  # type: ignore[misc]  # minigrid ships no types
    """A fully observed square grid with a goal. Subclasses generate the layout of a new episode.

    Args:
        render_mode: None, `"rgb_array"` or `"human"`.
        observation: `"cells"`, `"flat"` or `"one-hot"`: the form of the observations.
    """

    size: ClassVar[int]
    mission: str

    def __init__(self, *, render_mode: str | None = None, observation: str = CELLS, **unknown: Any) -> None:
        refuse_unknown(type(self).__name__, unknown, ["observation", "render_mode"])
        check_choice("observation", observation, FORMS)
        check_choice("render_mode", render_mode, [None, *self.metadata["render_modes"]])
        super().__init__(
            MissionSpace(self._mission),
            grid_size=self.size,
            max_steps=HORIZON,
            see_through_walls=True,
            render_mode=render_mode,
            highlight=False,
        )
        self.observation = observation
        self.observation_space = space_of(observation, self.size)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[Any], dict[str, Any]]:
        """Start an episode. A `seed` determines this and all following episodes."""
        observation, _ = super().reset(seed=seed, options=options)
        return observation, self._information(False)

    def step(self, action: int) -> tuple[NDArray[Any], float, bool, bool, dict[str, Any]]:
        """Take one action. Reaching the goal on the last step of the horizon terminates and does not truncate.

        Raises:
            TypeError: `action` is not an integer. No state has changed.
            ValueError: `action` is not in 0 .. 6. No state has changed.
        """
        action = check_integer("action", action, 0, NUM_ACTIONS - 1)
        observation, reward, terminated, truncated, _ = super().step(action)
        return observation, float(reward), terminated, truncated and not terminated, self._information(terminated)

    def gen_obs(self) -> NDArray[Any]:
        """Return the whole grid in the chosen form."""
        return shown(self.observation, self.whole_grid())

    def whole_grid(self) -> NDArray[np.uint8]:
        """Return the whole grid as [row y, column x, (type, colour, state)], with the agent in its cell."""
        cells = [_EMPTY_CELL if cell is None else bytes(cell.encode()) for cell in self.grid.grid]
        x, y = self.agent_pos
        cells[y * self.width + x] = bytes((AGENT, RED, self.agent_dir))
        return np.frombuffer(bytearray().join(cells), np.uint8).reshape(self.height, self.width, 3)

    def load(self, observation: NDArray[np.uint8], beneath: NDArray[np.uint8], carrying: bool, elapsed: int) -> None:
        """Set the state of a running episode, except for the random generator.

        Args:
            observation: The whole grid, uint8 [S, S, 3], with the agent on it.
            beneath: The cell that the agent stands on, uint8 [3].
            carrying: Whether the agent holds the (yellow) key.
            elapsed: Steps taken so far.
        """
        cells = observation.copy()
        (y, x) = np.argwhere(cells[..., 0] == AGENT)[0].tolist()
        self.agent_pos, self.agent_dir = (x, y), int(cells[y, x, 2])
        cells[y, x] = beneath
        self.grid, _ = Grid.decode(cells.swapaxes(0, 1))
        self.carrying = Key("yellow") if carrying else None
        self.step_count = elapsed

    def _information(self, is_success: bool) -> dict[str, Any]:
        return {"is_success": is_success, "position": np.array(self.agent_pos, dtype=np.int64)}

    @staticmethod
    @abstractmethod
    def _mission() -> str:
        """Return the task in words; the window shows it."""

    def __getstate__(self) -> dict[str, Any]:
        """Exclude the window and its clock: a copy opens its own when it is first drawn."""
        return {**self.__dict__, "window": None, "clock": None, "render_size": None}
