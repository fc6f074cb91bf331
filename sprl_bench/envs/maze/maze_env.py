"""One maze as a Gymnasium environment."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

import gymnasium
import numpy as np
from gymnasium.error import ResetNeeded
from gymnasium.spaces import Box, Discrete
from numpy.typing import NDArray

from sprl_bench.envs.checks import check_choice, check_integer, refuse_unknown
from sprl_bench.envs.maze import play
from sprl_bench.envs.maze.levels import GOAL_LARGE, GOAL_SMALL, OBJECT_MANY, Level
from sprl_bench.envs.maze.maze_rules import ARGUMENTS, ELSEWHERE, METADATA, RENDER_MODES, Variant
from sprl_bench.envs.maze.mazes import Mazes
from sprl_bench.envs.maze.raycast import SIDE
from sprl_bench.envs.maze.top_view import beside
from sprl_bench.envs.streams import from_generator, to_generator

Frame = NDArray[np.uint8]

OBSERVATIONS = Box(0, 255, (SIDE, SIDE, 3), np.uint8)
_THE_ONE = np.zeros(1, np.int64)
_SKIPPED = np.zeros(1, np.bool_)


class MazeEnv(gymnasium.Env[Frame, np.int64]):
    """
    ## Description

    The agent walks through a maze and sees it from its own eyes. The three levels stand for three levels of DeepMind
    Lab, with layouts of DeepMind Lab's own generator. Engine, textures and motion are our own, so scores do not compare
    with those on DeepMind Lab.

    - GoalSmall: 11 x 11 cells with the border, at most 4 rooms with sides of 3 to 5. Find the goal, again and again.
    - GoalLarge: 17 x 17 cells, at most 9 rooms of 3 x 3.
    - ObjectMany: one room of 11 x 11. Collect the four good objects and avoid the four bad ones.

    A cell is 100 units wide. The top speed is 320 units a second of 60 frames. An action lasts 4 frames: the agent
    moves by at most .2134 cells, or turns by 8.4 degrees. In each frame the velocity closes a quarter of its gap to the
    wanted one. The agent is 30 units wide and slides along walls.

    ## Action Space

    | Num | Name                 |
    |-----|----------------------|
    | 0   | forward              |
    | 1   | back                 |
    | 2   | strafe left          |
    | 3   | strafe right         |
    | 4   | look left            |
    | 5   | look right           |
    | 6   | look left + forward  |
    | 7   | look right + forward |
    | 8   | fire: no effect      |

    ## Observation Space

    `Box(0, 255, (84, 84, 3), uint8)`: the picture before the agent, 90 degrees wide, row by row from the top. The goal
    is a rhomb of gold, good objects are green discs, bad ones violet squares.

    `info` holds `is_success` (whether the episode has paid a positive reward), `position` (x, y in units, int64) and
    `goal_distance` (cells on the shortest path to the goal, or to the nearest good object).

    ## Rewards

    GoalSmall and GoalLarge: 10 at the goal. ObjectMany: 2 for a good object, -1 for a bad one. A thing is taken within
    30 units of its centre.

    ## Starting State

    An episode draws one of 10,000 layouts, the goal's or objects' places, the start, its direction, and all patterns
    and colours. At the goal, the agent goes on from another start, drawn anew; goal and maze stay. In ObjectMany, when
    all good objects are taken, objects and start are drawn anew. A new start ends the action.

    ## Episode End

    Truncated after 1,350 steps (GoalSmall) or 1,800. Never terminated.

    ## Arguments

    - `fire=True`: whether "fire" is among the actions.
    - `fog=False`: whether light fades with distance; nothing is seen beyond four cells.
    - `minimum_goal_distance=0`: the least number of cells from a start to the goal: at most 16 in GoalSmall, 32 in
      GoalLarge, 0 in ObjectMany. 10 is the "very sparse" variant. Places and layouts without such a start are skipped.
    - `render_mode`: None, `"rgb_array"` or `"human"`: what the agent sees, with the maze from above beside it.

    ## Registered Configurations

    - `SPRL/MazeGoalSmall-v1`
    - `SPRL/MazeGoalLarge-v1`
    - `SPRL/MazeObjectMany-v1`

    ## Version history

    - v1: first version.
    """  # noqa: D212, D415 - the sections have Minigrid's form

    metadata: dict[str, Any] = METADATA
    level: ClassVar[Level]

    def __init__(
        self,
        *,
        fire: bool = True,
        fog: bool = False,
        minimum_goal_distance: int = 0,
        render_mode: str | None = None,
        **unknown: Any,
    ) -> None:
        refuse_unknown(type(self).__name__, unknown, ARGUMENTS, ELSEWHERE)
        check_choice("render_mode", render_mode, [None, *RENDER_MODES])
        self.variant = Variant.checked(self.level, fire, fog, minimum_goal_distance)
        self.render_mode = render_mode
        self.observation_space = OBSERVATIONS
        self.action_space = Discrete(self.variant.num_actions)
        self.mazes = Mazes(self.level, self.variant, np.zeros((1, *OBSERVATIONS.shape), np.uint8))
        self._elapsed = np.zeros(1, np.int64)
        self._is_reset = False
        self._window: Any = None

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Frame, dict[str, Any]]:
        """Start an episode. A `seed` determines this and all following episodes."""
        super().reset(seed=seed, options=options)
        self._take_stream()
        self.mazes.restart(_THE_ONE)
        self._give_stream()
        self._elapsed[:] = 0
        self._is_reset = True
        self._draw_window()
        return self.mazes.frames[0].copy(), self._information()

    def step(self, action: Any) -> tuple[Frame, float, bool, bool, dict[str, Any]]:
        """Take one action.

        Raises:
            ResetNeeded: No episode has started.
            TypeError, ValueError: `action` is not an integer, or out of range. No state has changed.
        """
        if not self._is_reset:
            raise ResetNeeded("step() needs a reset() before it.")
        action = check_integer("action", action, 0, self.variant.num_actions - 1)
        rewards, truncations = np.zeros(1), np.zeros(1, np.bool_)
        self._elapsed += 1
        self._take_stream()
        play.advance(
            0, 1, np.array([action]), _SKIPPED, self._elapsed, *self.mazes.parts(), rewards, truncations
        )  # fmt: skip
        self._give_stream()
        self._draw_window()
        return self.mazes.frames[0].copy(), float(rewards[0]), False, bool(truncations[0]), self._information()

    def _take_stream(self) -> None:
        """Copy the state of the generator, from which the compiled functions draw."""
        self.mazes.worlds.streams[0] = self._stream = from_generator(self.np_random)

    def _give_stream(self) -> None:
        """Move the generator on by what was drawn."""
        stream = self.mazes.worlds.streams[0]
        if (stream != self._stream).any():
            self.np_random.bit_generator.state = to_generator(stream).bit_generator.state

    def load(self, state: Mapping[str, NDArray[Any]], elapsed: int) -> None:
        """Set the state of a running episode, except for the random generator.

        Args:
            state: One row of each array of an engine's mazes, by name.
            elapsed: Steps taken so far.
        """
        for name, values in self.mazes.worlds.state().items():
            values[0] = state[name]
        self._elapsed[:] = elapsed
        self._is_reset = True
        self.mazes.restore()

    def _information(self) -> dict[str, Any]:
        information = self.mazes.information()
        return {
            "is_success": bool(information["is_success"][0]),
            "position": information["position"][0],
            "goal_distance": int(information["goal_distance"][0]),
        }

    def render(self) -> Any:
        """Return a picture, uint8 [336, 672, 3], or show it with `"human"`; the maze does not change."""
        if self.render_mode is None:
            gymnasium.logger.warn(f'{self} has no render mode; make it with render_mode="rgb_array" or "human".')
            return None
        if not self._is_reset:
            raise ResetNeeded("render() needs a reset() before it.")
        inside = self.mazes.worlds
        picture = beside(self.mazes.frames[0], inside.cells[0], inside.poses[0], inside.things[0])
        return picture if self.render_mode == "rgb_array" else self._show(picture)

    def _show(self, picture: Frame) -> None:
        from sprl_bench.envs.maze.maze_window import Window  # noqa: PLC0415 - loads pygame

        if self._window is None:
            self._window = Window()
        self._window.show(picture, self.metadata["render_fps"])

    def _draw_window(self) -> None:
        if self.render_mode == "human":
            self.render()

    def close(self) -> None:
        """Close the window, if there is one."""
        if self._window is not None:
            self._window.close()
            self._window = None

    def __getstate__(self) -> dict[str, Any]:
        """Exclude the window: a copy opens its own when it is first drawn."""
        return {**self.__dict__, "_window": None}


class MazeGoalSmall(MazeEnv):
    """A maze of 11 x 11 cells with a goal."""

    level = GOAL_SMALL


class MazeGoalLarge(MazeEnv):
    """A maze of 17 x 17 cells with a goal."""

    level = GOAL_LARGE


class MazeObjectMany(MazeEnv):
    """A room of 11 x 11 cells with four good and four bad objects."""

    level = OBJECT_MANY
