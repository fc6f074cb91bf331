"""Probe environments: tiny tasks whose best return, and that of chance, are known exactly.

Each asks for one part of a learner: that a reward is seen at all, that it is credited to an action taken some steps
before, that the action depends on the observation. They have the spaces of FourRooms-7x7, and show two of its maps, so
an agent for that task needs no other network.
"""

from __future__ import annotations

from typing import Any, Final

import gymnasium
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

Map = NDArray[np.uint8]
Step = tuple[Map, float, bool, bool, dict[str, Any]]

GRID: Final = "SPRL/FourRooms-7x7-v1"
ACTIONS: Final = 7
DELAY: Final = 4  # steps between the action that counts and its reward
SHOWN: Final = (0, 1)  # seeds of the maps


class Probe(gymnasium.Env[Map, np.int64]):
    """One decision at the start of an episode, and a reward for it `delay` steps later.

    The first observation of an episode is one of `contexts` maps, drawn uniformly. The action that is right there is
    the map's number; the reward is 1 if it was taken, and for any action if `any_action`. It is -1 for the action that
    is right on another map, so that a policy which does not look earns 0. During the delay the first map is shown,
    whichever was shown before.

    Args:
        contexts: How many maps there are, 1 or 2.
        delay: Steps between the decision and the reward.
        any_action: Whether every action is right.
    """

    metadata: dict[str, Any] = {"render_modes": []}  # noqa: RUF012 - Gymnasium's own type

    def __init__(
        self, contexts: int = 1, delay: int = 0, any_action: bool = False, render_mode: str | None = None
    ) -> None:
        self.observation_space = spaces.Box(0, 255, (7, 7, 3), np.uint8)
        self.action_space = spaces.Discrete(ACTIONS)
        self.render_mode = render_mode
        self._maps = _maps()[:contexts]
        self._delay, self._any_action = delay, any_action
        self._context, self._steps, self._earned = 0, 0, 0.0

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Map, dict[str, Any]]:
        """Draw a map and show it."""
        super().reset(seed=seed, options=options)
        self._context, self._steps = int(self.np_random.integers(len(self._maps))), 0
        return self._shown(self._context, success=False)

    def step(self, action: np.int64) -> Step:
        """Take the decision, or wait for its reward."""
        if self._steps == 0:
            self._earned = self._reward(int(action))
        self._steps += 1
        ended = self._steps > self._delay
        reward = self._earned if ended else 0.0
        observation, info = self._shown(0, success=reward > 0)
        return observation, reward, ended, False, info

    def _reward(self, action: int) -> float:
        if self._any_action or action == self._context:
            return 1.0
        return -1.0 if action < len(self._maps) else 0.0

    def _shown(self, context: int, *, success: bool) -> tuple[Map, dict[str, Any]]:
        observation, position = self._maps[context]
        return observation.copy(), {"is_success": success, "position": position.copy()}


def _maps() -> list[tuple[Map, NDArray[np.int64]]]:
    """Return two maps of FourRooms, each with the agent's position."""
    grid = gymnasium.make(GRID)
    shown = [grid.reset(seed=seed) for seed in SHOWN]
    grid.close()
    return [(observation, np.asarray(info["position"], np.int64)) for observation, info in shown]


def register() -> None:
    """Register the probes with Gymnasium, once."""
    for name, arguments in ARGUMENTS.items():
        if name not in gymnasium.registry:
            gymnasium.register(name, entry_point=f"{__name__}:Probe", kwargs=arguments)


ARGUMENTS: Final[dict[str, dict[str, Any]]] = {
    "SPRLProbe/Any-v0": {"any_action": True},
    "SPRLProbe/Delay-v0": {"delay": DELAY},
    "SPRLProbe/Observation-v0": {"contexts": 2},
}
KNOWN: Final = {  # the return of chance, and the best
    "SPRLProbe/Any-v0": (1.0, 1.0),
    "SPRLProbe/Delay-v0": (1 / ACTIONS, 1.0),
    "SPRLProbe/Observation-v0": (0.0, 1.0),
}
