"""The random agent: it draws actions uniformly and learns nothing. It is the baseline of all other agents."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from gymnasium.vector import VectorEnv

from sprl_baselines.learning.config import Config, Count, reject_unknown
from sprl_bench.actions import uniform_actions

STEPS_PER_REPORT = 256  # steps of each sub-env between two yields


@dataclass(frozen=True)
class RandomConfig(Config):
    """Hyperparameters of the random agent."""

    num_envs: Count = 12  # sub-envs that step together; the harness reads this


class RandomAgent:
    """Draws each action uniformly from the action space with its own generator."""

    def __init__(self, seed: int) -> None:
        self._generator = np.random.default_rng(seed)
        self._steps = 0

    def train(self, envs: VectorEnv[Any, Any, Any], budget: int) -> Iterator[dict[str, float]]:
        """Act until `budget` env steps are taken; yield every 256 steps of each sub-env."""
        if self._steps == 0:
            envs.reset()
        while self._steps < budget:
            for _ in range(STEPS_PER_REPORT):
                envs.step(uniform_actions(envs.single_action_space, envs.num_envs, self._generator))
            self._steps += STEPS_PER_REPORT * envs.num_envs
            yield {}

    def state_dict(self) -> dict[str, Any]:
        """Return the steps taken and the generator's state."""
        return {"steps": self._steps, "generator": self._generator.bit_generator.state}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Restore such a state."""
        self._steps = int(state["steps"])
        self._generator.bit_generator.state = state["generator"]


class RandomAgentFactory:
    """Makes random agents."""

    privileged = False

    def __call__(self, *, seed: int, device: str = "cpu", **hyperparameters: Any) -> RandomAgent:  # noqa: ARG002 - needs no device
        """Make a random agent.

        Raises:
            ValueError: A hyperparameter is unknown or out of range.
        """
        self.hyperparameters("any", hyperparameters)
        return RandomAgent(seed)

    def hyperparameters(self, domain: str, overrides: Mapping[str, Any]) -> dict[str, Any]:  # noqa: ARG002 - the same in all
        """Return all hyperparameters; they are the same in every domain.

        Raises:
            ValueError: A hyperparameter is unknown or out of range.
        """
        reject_unknown("hyperparameter", overrides, RandomConfig.names())
        return RandomConfig.pick(overrides).as_dict()


random = RandomAgentFactory()
