"""The three levels: their facts, and the codes of cells, things and actions.

The facts are those of DeepMind Lab's levels (sizes, rooms, places, rewards, lengths).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, Final

# Cells of a layout.
WALL: Final = 0
CORRIDOR: Final = 1
FLOOR: Final = 2  # of a room
SPAWN: Final = 3  # where the agent may start
PLACE: Final = 4  # where the goal or an object may be

# Things.
NOTHING: Final = 0
GOAL: Final = 1
GOOD: Final = 2
BAD: Final = 3
REWARDS: Final = (0.0, 10.0, 2.0, -1.0)
"""The reward for taking each kind of thing."""

# Actions.
FORWARD: Final = 0
BACK: Final = 1
STRAFE_LEFT: Final = 2
STRAFE_RIGHT: Final = 3
LOOK_LEFT: Final = 4
LOOK_RIGHT: Final = 5
LOOK_LEFT_FORWARD: Final = 6
LOOK_RIGHT_FORWARD: Final = 7
FIRE: Final = 8
NUM_ACTIONS: Final = 9

FRAMES: Final = 4  # of physics for each action
FRAMES_A_SECOND: Final = 60
UNITS_A_CELL: Final = 100
GOOD_OBJECTS: Final = 4
NUM_LAYOUTS: Final = 10_000
"""Layouts of each level in the bank: those of the generator's seeds 0, 1, 2, ..."""


@dataclass(frozen=True)
class Level:
    """One level.

    Attributes:
        name: As in the environment's id, after "Maze".
        size: Cells along a side, border included.
        horizon: Agent steps of an episode.
        num_things: Things in the maze at the start: the goal, or objects.
        farthest: The largest `minimum_goal_distance` that at least a tenth of the layouts can satisfy; 0 for a level
            without a goal.
    """

    name: str
    size: int
    horizon: int
    num_things: int
    farthest: int

    @property
    def has_goal(self) -> bool:
        """Whether the level has a goal, and not objects."""
        return self.num_things == 1


GOAL_SMALL: Final = Level("GoalSmall", 11, 1350, 1, 16)
GOAL_LARGE: Final = Level("GoalLarge", 17, 1800, 1, 32)
OBJECT_MANY: Final = Level("ObjectMany", 13, 1800, 8, 0)
LEVELS: Mapping[str, Level] = MappingProxyType({level.name: level for level in (GOAL_SMALL, GOAL_LARGE, OBJECT_MANY)})


def _generator(size: int, rooms: int, sides: tuple[int, int], spawns: int, places: int) -> Mapping[str, Any]:
    return MappingProxyType(
        {
            "height": size,
            "width": size,
            "max_rooms": rooms,
            "room_min_size": sides[0],
            "room_max_size": sides[1],
            "spawns_per_room": spawns,
            "objects_per_room": places,
            "object_token": "G",
            "extra_connection_probability": 0,
            "max_variations": 1,
        }
    )


GENERATORS: Mapping[str, Mapping[str, Any]] = MappingProxyType(
    {
        "GoalSmall": _generator(11, 4, (3, 5), 5, 4),
        "GoalLarge": _generator(17, 9, (3, 3), 5, 5),
        "ObjectMany": _generator(13, 1, (11, 11), 5, 16),
    }
)
"""By level, the arguments of labmaze's `RandomMaze`, DeepMind Lab's own generator of layouts."""
