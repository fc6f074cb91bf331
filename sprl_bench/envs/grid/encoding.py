"""The encoding of grid observations: the three numbers of a cell, and the numbers of the actions.

The numbers are Minigrid's. They are repeated here so that the engine and the solver do not import it.
"""

from __future__ import annotations

from enum import IntEnum
from typing import Final

# Channel 0: the type of the object in the cell.
EMPTY: Final = 1
WALL: Final = 2
DOOR: Final = 4
KEY: Final = 5
GOAL: Final = 8
AGENT: Final = 10

# Channel 1: its colour. Walls are grey, the goal green, key and door yellow; an empty cell and the agent have 0.
RED: Final = 0
GREEN: Final = 1
YELLOW: Final = 4
GREY: Final = 5

# Channel 2: the state of a door, or the direction of the agent.
OPEN: Final = 0
CLOSED: Final = 1
LOCKED: Final = 2

RIGHT: Final = 0
DOWN: Final = 1
LEFT: Final = 2
UP: Final = 3

TURN_LEFT: Final = 0
TURN_RIGHT: Final = 1
FORWARD: Final = 2
PICKUP: Final = 3
DROP: Final = 4
TOGGLE: Final = 5
DONE: Final = 6
NUM_ACTIONS: Final = 7


class Action(IntEnum):
    """The actions by name; each is also its number."""

    LEFT = TURN_LEFT
    RIGHT = TURN_RIGHT
    FORWARD = FORWARD
    PICKUP = PICKUP
    DROP = DROP
    TOGGLE = TOGGLE
    DONE = DONE


HORIZON: Final = 100
"""Steps after which an episode is truncated; also the divisor in the reward."""
