"""The arguments of a maze, checked, and what follows from them for the engine."""

from __future__ import annotations

from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, Final

from sprl_bench.envs.checks import check_integer
from sprl_bench.envs.maze.levels import FRAMES, FRAMES_A_SECOND, NUM_ACTIONS, Level
from sprl_bench.envs.maze.worlds import Rules

RENDER_MODES: Final = ("human", "rgb_array")
ARGUMENTS: Final = ("fire", "fog", "minimum_goal_distance", "render_mode")
ELSEWHERE: Final = MappingProxyType(
    {
        **dict.fromkeys(("shoot", "attack"), "fire"),
        **dict.fromkeys(("min_goal_distance", "goal_distance", "min_distance"), "minimum_goal_distance"),
    }
)
"""Other names for the arguments of a maze."""
METADATA: Final[dict[str, Any]] = {"render_modes": list(RENDER_MODES), "render_fps": FRAMES_A_SECOND // FRAMES}


@dataclass(frozen=True)
class Variant:
    """The arguments that change the decision process.

    Attributes:
        fire: Whether the action "fire", which has no effect, is among the actions.
        fog: Whether light fades with distance; nothing is seen beyond four cells.
        minimum_goal_distance: The least number of cells on the shortest path from a start to the goal.
    """

    fire: bool = True
    fog: bool = False
    minimum_goal_distance: int = 0

    @classmethod
    def checked(cls, level: Level, fire: object, fog: object, minimum_goal_distance: object) -> Variant:
        """Return the variant of a level with these arguments.

        Raises:
            TypeError, ValueError: A value is not allowed.
        """
        distance = check_integer("minimum_goal_distance", minimum_goal_distance, 0, level.farthest)
        return cls(_flag("fire", fire), _flag("fog", fog), distance)

    @property
    def num_actions(self) -> int:
        """The number of actions; "fire" is the last one."""
        return NUM_ACTIONS if self.fire else NUM_ACTIONS - 1

    def rules(self, level: Level) -> Rules:
        """Return the rules of the engine."""
        return Rules(level.horizon, self.minimum_goal_distance, self.fog)


def _flag(name: str, value: object) -> bool:
    if not isinstance(value, bool):
        raise TypeError(f"{name} is {value!r}; it must be True or False.")
    return value
