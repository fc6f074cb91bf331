"""Golden episodes: how a reward is come by in our environments, which chance does not show in a few hundred steps.

Seeds and actions are constants, found once by the exact solver on the grids and by looking through seeds on the Fetch
tasks. Should an environment change, they may lead nowhere; then the fingerprint changes all the more.
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
        seeds: What each is reset with.
        paths: The actions of each, a digit an action; both are equally long. Empty where actions are continuous: there
            they stand still for one step.
    """

    seeds: tuple[int, int]
    paths: tuple[str, str] = ("", "")

    def actions(self, space: Space[Any]) -> Iterator[Any]:
        """Yield the actions of both, `[2]` or `[2, A]`, step by step; `space` is that of one action."""
        if isinstance(space, spaces.Box):
            yield np.zeros((2, *space.shape), space.dtype)
        for both in zip(*self.paths, strict=True):
            yield np.array(both, np.int64)


# On the grids both episodes end at the goal; of the Fetch tasks' the first begins within reach of it, the second just
# beyond, so that the distance that counts as reached shows as well.
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
    }
)
