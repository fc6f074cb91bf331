"""Policies and an agent that can show what it has learned, for the tests of videos."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from gymnasium import Space
from harness_fakes import ResumableWalker

FORWARD, TURN_LEFT = 2, 0


def turn(observation: Any) -> int:
    return TURN_LEFT


def failing(observation: Any) -> int:
    raise ZeroDivisionError("the policy divided by zero")


class Actor(ResumableWalker):
    """Walks ahead once it has learned, and turns on the spot before."""

    def weights(self) -> dict[str, Any]:
        return self.state_dict()

    def policy(self, observation_space: Space[Any], action_space: Space[Any], seed: int) -> Callable[[Any], int]:
        assert action_space.n == 7
        return lambda _observation: FORWARD if self._updates > 0 else TURN_LEFT


def actor(*, seed: int, device: str = "cpu", num_envs: int = 3) -> Actor:
    return Actor(seed, 20, "", 0, 0.0)
