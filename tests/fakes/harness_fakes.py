"""Agents and environments for the harness's tests; a module of its own, so that worker processes can import it."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Iterator, Mapping
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import VectorEnv

Episode = tuple[list[float], bool]
"""Rewards, and whether it ends by success (terminated) or not (truncated)."""


class Scripted(gymnasium.Env[np.ndarray, int]):
    """Plays given episodes one after the other, whatever the actions, and then the last one again and again."""

    observation_space = gymnasium.spaces.Box(0, 1, (1,))
    action_space = gymnasium.spaces.Discrete(2)

    def __init__(self, episodes: list[Episode], substep: int = 20) -> None:
        self._episodes, self._next = episodes, 0
        self.substep = substep

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[np.ndarray, dict]:
        super().reset(seed=seed)
        self._rewards, self._success = self._episodes[min(self._next, len(self._episodes) - 1)]
        self._next, self._time = self._next + 1, 0
        return np.zeros(1, np.float32), {"is_success": False}

    def step(self, action: int) -> tuple[np.ndarray, float, bool, bool, dict]:
        reward = self._rewards[min(self._time, len(self._rewards) - 1)]
        self._time += 1
        ended = self._time >= len(self._rewards)
        success = ended and self._success
        return np.ones(1, np.float32), reward, success, ended and not self._success, {"is_success": success}


class Walker:
    """Acts at random, resumably; and does on request what agents do at their worst."""

    def __init__(self, seed: int, rollout: int, trouble: str, after: int, pause_s: float) -> None:
        self._generator = np.random.default_rng(seed)
        self._rollout, self._trouble, self._after, self._pause_s = rollout, trouble, after, pause_s
        self._updates = 0

    def train(self, envs: VectorEnv[Any, Any, Any], budget: int) -> Iterator[dict[str, float]]:
        if self._updates == 0:
            envs.reset()
        while True:
            for _ in range(self._rollout):
                envs.step(self._generator.integers(3, size=envs.num_envs))
            self._updates += 1
            time.sleep(self._pause_s)
            if self._updates == self._after:
                self._misbehave()
                if self._trouble == "stop":
                    return
            boast = {"env_steps": float("nan")} if self._trouble == "boast" else {}
            yield {"updates": self._updates, "loss": float("nan"), **boast}

    def _misbehave(self) -> None:
        match self._trouble:
            case "raise":
                raise ZeroDivisionError("the agent divided by zero")
            case "die":
                os.kill(os.getpid(), signal.SIGKILL)
            case "terminate":
                os.kill(os.getpid(), signal.SIGTERM)
            case "print":
                os.write(1, b"hello from compiled code\n")


class ResumableWalker(Walker):
    def state_dict(self) -> dict[str, Any]:
        return {"updates": self._updates, "generator": self._generator.bit_generator.state}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        self._updates = state["updates"]
        self._generator.bit_generator.state = state["generator"]


def walker(
    *,
    seed: int,
    device: str = "cpu",
    num_envs: int = 3,
    rollout: int = 20,
    trouble: str = "",
    after: int = 0,
    pause_s: float = 0.0,
) -> ResumableWalker:
    return ResumableWalker(seed, rollout, trouble, after, pause_s)


def forgetful(*, seed: int, device: str = "cpu", trouble: str = "", after: int = 0) -> Walker:
    return Walker(seed, 20, trouble, after, 0.0)


def broken(*, seed: int, device: str = "cpu", num_envs: int = 3) -> Walker:
    return Walker(seed, 20, "raise", 2, 0.0)


def dying(*, seed: int, device: str = "cpu", num_envs: int = 3) -> Walker:
    return Walker(seed, 20, "die", 2, 0.0)


broken.privileged = True  # type: ignore[attr-defined]


def demanding(*, seed: int, depth: int, device: str = "cpu", width: int) -> Walker:
    """Two hyperparameters have no default."""
    return Walker(seed, 20, "", 0, 0.0)


def anything(*, seed: int, device: str = "cpu", **hyperparameters: Any) -> Walker:
    """It takes what it is given."""
    return Walker(seed, 20, "", 0, 0.0)


def parallel(*, seed: int, device: str = "cpu", num_envs: int) -> Walker:
    """The number of environments has no default."""
    return Walker(seed, 20, "", 0, 0.0)
