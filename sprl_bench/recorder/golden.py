"""Golden episodes: action sequences that reach the reward of our environments, which random actions rarely do.

Seeds and actions are constants: found by the exact solver on grids and mazes, and by a search over seeds on the Fetch
tasks. If an environment changes, they may no longer reach it; the fingerprint then changes too.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, Final

import numpy as np
from gymnasium import Space, spaces


@dataclass(frozen=True)
class Golden:
    """Two episodes that are played side by side.

    Attributes:
        seeds: Of each episode's reset.
        paths: The actions of each, a digit an action, equally long. Empty for continuous actions: one step without
            motion.
    """

    seeds: tuple[int, int]
    paths: tuple[str, str] = ("", "")

    def actions(self, space: Space[Any]) -> Iterator[Any]:
        """Yield the actions of both, `[2]` or `[2, A]`, step by step; `space` is that of one action."""
        if isinstance(space, spaces.Box):
            yield np.zeros((2, *space.shape), space.dtype)
        for both in zip(*self.paths, strict=True):
            yield np.array(both, np.int64)


# On the grids both episodes end at the goal; in the mazes both reach it, or a good object, with the last action. On the
# Fetch tasks the first begins within the distance that counts as success and the second just outside it.
GOLDEN: Final[Mapping[str, Golden]] = MappingProxyType(
    {
        "SPRL/FourRooms-7x7-v1": Golden((17, 19), ("222122", "022202")),
        "SPRL/FourRooms-11x11-v1": Golden((36, 367), ("122212", "022212")),
        "SPRL/KeyDoors-7x7-v1": Golden((23, 29), ("22030022052212", "00230020522022")),
        "SPRL/KeyDoors-11x11-v1": Golden((16, 277), ("02213025220222", "20223221252222")),
        "SPRL/FetchReachSparse-v1": Golden((99, 128)),
        "SPRL/FetchPushSparse-v1": Golden((84, 493)),
        "SPRL/FetchSlideSparse-v1": Golden((766, 4537)),
        "SPRL/FetchPickAndPlaceSparse-v1": Golden((84, 493)),
        "SPRL/MazeGoalSmall-v1": Golden((1777, 1931), ("55777744664464", "46666555775577")),
        "SPRL/MazeGoalLarge-v1": Golden((1337, 2630), ("4446666666060", "6666555775577")),
        "SPRL/MazeObjectMany-v1": Golden((1734, 2154), ("46666555775577", "46666557755577")),
    }
)
