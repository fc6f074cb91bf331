"""The batched grid engine: bit-identical to the single environments, in a few compiled calls for each step."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, ClassVar

import gymnasium
import numpy as np
from gymnasium.spaces import Discrete
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from sprl_bench.envs.checks import check_choice, refuse_unknown_of_engine
from sprl_bench.envs.discrete_actions import DiscreteActions
from sprl_bench.envs.engine import Array, Rows
from sprl_bench.envs.grid import dynamics
from sprl_bench.envs.grid.encoding import AGENT, DOOR, EMPTY, GOAL, NUM_ACTIONS, RED, WALL
from sprl_bench.envs.grid.four_rooms import FourRooms7x7, FourRooms11x11
from sprl_bench.envs.grid.grid_env import GridEnv
from sprl_bench.envs.grid.key_doors import KeyDoors7x7, KeyDoors11x11
from sprl_bench.envs.grid.observations import CELLS, FORMS, shown, space_of
from sprl_bench.envs.streams import STREAM_LIMBS, seed_streams, to_generator
from sprl_bench.envs.vector import BatchedEnv


class GridEngine(BatchedEnv):
    """N grids stepped by compiled kernels.

    Args:
        num_envs: Number of sub-environments N.
        observation: As in `GridEnv`. The state of the engine is the same in each form.
        arguments: The arguments of `BatchedEnv`.
    """

    metadata = GridEnv.metadata
    grain = 2048
    single: ClassVar[type[GridEnv]]
    restart_kernel: ClassVar[Callable[..., None]]

    def __init__(self, num_envs: int = 1, *, observation: str = CELLS, **arguments: Any) -> None:
        refuse_unknown_of_engine(type(self).__name__, arguments, ["observation"])
        check_choice("observation", observation, FORMS)
        super().__init__(
            num_envs,
            single_observation_space=space_of(CELLS, self.single.size),
            single_action_space=Discrete(NUM_ACTIONS),
            **arguments,
        )
        self.observation = observation
        self.single_observation_space = space_of(observation, self.single.size)
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        self._agents = np.zeros((self.num_envs, 3), np.int64)
        self._beneath = np.zeros((self.num_envs, 3), np.uint8)
        self._carrying = np.zeros(self.num_envs, np.bool_)
        self._streams = np.zeros((self.num_envs, STREAM_LIMBS), np.uint64)
        self._actions = DiscreteActions(self.num_envs, NUM_ACTIONS - 1)
        self._is_success = np.zeros(self.num_envs, np.bool_)

    def _shown(self, observations: Array) -> Array:
        return shown(self.observation, observations)

    def _seed(self, rows: Rows, seeds: list[int]) -> None:
        seed_streams(self._streams, rows, seeds)

    def _restart(self, rows: Rows) -> None:
        self.restart_kernel(rows, self._observations, self._agents, self._beneath, self._carrying, self._streams)
        self._is_success[rows] = False

    def _advance(self, actions: NDArray[np.int64]) -> None:
        self._threads.map(
            dynamics.advance,
            self.num_envs,
            actions,
            self._ended,
            self._elapsed,
            self._observations,
            self._agents,
            self._beneath,
            self._carrying,
            self._rewards,
            self._terminations,
            self._truncations,
        )
        self._is_success[:] = self._terminations

    def _checked_actions(self, actions: Any) -> NDArray[np.int64]:
        return self._actions.checked(actions, self._ended)

    def _information(self) -> Mapping[str, Array]:
        return {"is_success": self._is_success, "position": self._agents[:, :2]}

    def _kind(self) -> str:
        return self.single.__name__

    def _arrays(self) -> Mapping[str, Array]:
        return {
            "observations": self._observations,
            "agents": self._agents,
            "beneath": self._beneath,
            "carrying": self._carrying,
            "streams": self._streams,
        }

    def _check_state(self, state: Mapping[str, Array]) -> None:
        cells, (x, y, direction) = state["observations"][..., 0], state["agents"].T
        walled = (cells[:, [0, -1]] == WALL).all() and (cells[:, :, [0, -1]] == WALL).all()
        if not walled or (cells > AGENT).any():
            raise ValueError("state['observations'] has a grid without an outer wall; it must be grids of these tasks.")
        inside = (x > 0) & (x < self.single.size - 1) & (y > 0) & (y < self.single.size - 1)
        if not (inside & (direction >= 0) & (direction < 4)).all():
            raise ValueError("state['agents'] is out of range; it must be x, y inside the walls and a direction.")
        drawn = state["observations"][np.arange(self.num_envs), y, x] == np.stack(
            [np.full_like(direction, AGENT), np.full_like(direction, RED), direction], axis=1
        )
        if not drawn.all() or ((cells == AGENT).sum(axis=(1, 2)) != 1).any():
            raise ValueError("state['agents'] differs from state['observations']; it must be the agents' poses there.")
        if not np.isin(state["beneath"][:, 0], (EMPTY, DOOR, GOAL)).all():
            raise ValueError("state['beneath'] has another cell; it must be empty cells, doors or goals.")

    def _generator(self, row: int) -> np.random.Generator:
        return to_generator(self._streams[row])

    def _load(self, single: gymnasium.Env[Array, Any], row: int) -> None:
        single.unwrapped.load(  # type: ignore[attr-defined]  # GridEnv's
            self._observations[row], self._beneath[row], bool(self._carrying[row]), int(self._elapsed[row])
        )

    def _single(self) -> GridEnv:
        return self.single(render_mode=self.render_mode, observation=self.observation)


class FourRooms7x7Engine(GridEngine):
    """N FourRooms with S = 7."""

    single = FourRooms7x7
    restart_kernel = staticmethod(dynamics.restart_four_rooms)


class FourRooms11x11Engine(GridEngine):
    """N FourRooms with S = 11."""

    single = FourRooms11x11
    restart_kernel = staticmethod(dynamics.restart_four_rooms)


class KeyDoors7x7Engine(GridEngine):
    """N KeyDoors with S = 7."""

    single = KeyDoors7x7
    restart_kernel = staticmethod(dynamics.restart_key_doors)


class KeyDoors11x11Engine(GridEngine):
    """N KeyDoors with S = 11."""

    single = KeyDoors11x11
    restart_kernel = staticmethod(dynamics.restart_key_doors)
