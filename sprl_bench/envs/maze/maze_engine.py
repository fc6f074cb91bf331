"""The batched maze engine: bit-identical to the single environments, as both call the same compiled functions."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

import gymnasium
import numpy as np
from gymnasium.spaces import Discrete
from numpy.typing import NDArray

from sprl_bench.envs.checks import refuse_unknown_of_engine
from sprl_bench.envs.discrete_actions import DiscreteActions
from sprl_bench.envs.engine import Array, Rows
from sprl_bench.envs.maze import play
from sprl_bench.envs.maze.levels import Level
from sprl_bench.envs.maze.maze_env import OBSERVATIONS, MazeEnv, MazeGoalLarge, MazeGoalSmall, MazeObjectMany
from sprl_bench.envs.maze.maze_rules import ARGUMENTS, ELSEWHERE, METADATA, Variant
from sprl_bench.envs.maze.mazes import Mazes
from sprl_bench.envs.streams import seed_streams, to_generator
from sprl_bench.envs.vector import BatchedEnv


class MazeEngine(BatchedEnv):
    """N mazes of one level.

    Args:
        num_envs: Number of sub-environments N.
        fire: As in `MazeEnv`.
        fog: As in `MazeEnv`.
        minimum_goal_distance: As in `MazeEnv`.
        arguments: The arguments of `BatchedEnv`.
    """

    metadata = METADATA
    grain = 8
    single: ClassVar[type[MazeEnv]]

    def __init__(
        self,
        num_envs: int = 1,
        *,
        fire: bool = True,
        fog: bool = False,
        minimum_goal_distance: int = 0,
        **arguments: Any,
    ) -> None:
        refuse_unknown_of_engine(type(self).__name__, arguments, ARGUMENTS, ELSEWHERE)
        self.variant = Variant.checked(self.level, fire, fog, minimum_goal_distance)
        super().__init__(
            num_envs,
            single_observation_space=OBSERVATIONS,
            single_action_space=Discrete(self.variant.num_actions),
            **arguments,
        )
        self.mazes = Mazes(self.level, self.variant, self._observations)
        self._actions = DiscreteActions(self.num_envs, self.variant.num_actions - 1)

    @property
    def level(self) -> Level:
        """The level of all mazes."""
        return self.single.level

    def _seed(self, rows: Rows, seeds: list[int]) -> None:
        seed_streams(self.mazes.worlds.streams, rows, seeds)

    def _restart(self, rows: Rows) -> None:
        self.mazes.restart(rows)

    def _advance(self, actions: NDArray[np.int64]) -> None:
        self._threads.map(
            play.advance,
            self.num_envs,
            actions,
            self._ended,
            self._elapsed,
            *self.mazes.parts(),
            self._rewards,
            self._truncations,
        )

    def _checked_actions(self, actions: Any) -> NDArray[np.int64]:
        return self._actions.checked(actions, self._ended)

    def _information(self) -> Mapping[str, Array]:
        return self.mazes.information()

    def _kind(self) -> str:
        return f"{self.level.name} {self.variant}"

    def _arrays(self) -> Mapping[str, Array]:
        return self.mazes.worlds.state()

    def _check_state(self, state: Mapping[str, Array]) -> None:
        self.mazes.check_state(state)

    def set_state(self, state: Mapping[str, Array]) -> None:
        """Restore a state from `get_state` of an engine with the same id, arguments and N.

        Raises:
            ValueError: The state is not from such an engine. No state has changed.
        """
        super().set_state(state)
        self.mazes.restore()

    def _generator(self, row: int) -> np.random.Generator:
        return to_generator(self.mazes.worlds.streams[row])

    def _load(self, single: gymnasium.Env[Array, Any], row: int) -> None:
        assert isinstance(single, MazeEnv)
        state = {name: values[row] for name, values in self.mazes.worlds.state().items()}
        single.load(state, int(self._elapsed[row]))

    def _single(self) -> MazeEnv:
        return self.single(
            fire=self.variant.fire,
            fog=self.variant.fog,
            minimum_goal_distance=self.variant.minimum_goal_distance,
            render_mode=self.render_mode,
        )


class MazeGoalSmallEngine(MazeEngine):
    """N mazes of 11 x 11 cells with a goal."""

    single = MazeGoalSmall


class MazeGoalLargeEngine(MazeEngine):
    """N mazes of 17 x 17 cells with a goal."""

    single = MazeGoalLarge


class MazeObjectManyEngine(MazeEngine):
    """N rooms of 11 x 11 cells with four good and four bad objects."""

    single = MazeObjectMany
