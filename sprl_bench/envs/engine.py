"""The interface of a batched engine: the arrays of N sub-environments, and the functions that change them.

An engine only has the dynamics of its task; `BatchedEnv` turns it into a vector environment.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from typing import Any, ClassVar

import gymnasium
import numpy as np
from gymnasium.vector import VectorEnv
from numpy.typing import NDArray

Array = NDArray[Any]
Rows = NDArray[np.int64]
Mask = NDArray[np.bool_]


class Engine(VectorEnv[Array, Array, Array]):
    """N copies of one environment, stored as arrays. Each task implements the abstract methods."""

    grain: ClassVar[int] = 1
    """The smallest number of sub-environments for which a thread is worthwhile."""

    _observations: Array  # [N, ...], current; filled by _restart and _advance
    _rewards: NDArray[np.float64]  # [N]
    _terminations: Mask  # [N]
    _truncations: Mask  # [N]
    _elapsed: Rows  # [N] steps of the running episode
    _ended: Mask  # [N] episode over and not yet restarted; stays False under SameStep
    _seeds: list[int | None]  # [N], None if never seeded
    _is_reset: bool

    def _allocate(self) -> None:
        """Allocate the arrays for `num_envs` and `single_observation_space`."""
        shape, dtype = self.single_observation_space.shape, self.single_observation_space.dtype
        assert shape is not None
        self._observations = np.zeros((self.num_envs, *shape), dtype)
        self._rewards = np.zeros(self.num_envs, np.float64)
        self._terminations = np.zeros(self.num_envs, np.bool_)
        self._truncations = np.zeros(self.num_envs, np.bool_)
        self._elapsed = np.zeros(self.num_envs, np.int64)
        self._ended = np.zeros(self.num_envs, np.bool_)
        self._seeds = [None] * self.num_envs
        self._is_reset = False

    @abstractmethod
    def _seed(self, rows: Rows, seeds: list[int]) -> None:
        """Seed the random streams of the sub-environments `rows`, like `gymnasium.utils.seeding.np_random`."""

    @abstractmethod
    def _restart(self, rows: Rows) -> None:
        """Start a new episode in the sub-environments `rows`: set their observations and information."""

    @abstractmethod
    def _advance(self, actions: Array) -> None:
        """Step each sub-environment that has not ended: set observations, information, rewards and flags.

        The others get reward 0 and both flags False. `_elapsed` already includes this step.
        """

    @abstractmethod
    def _checked_actions(self, actions: Any) -> Array:
        """Return the actions in the form that `_advance` needs, or raise an error without any change."""

    @abstractmethod
    def _information(self) -> Mapping[str, Array]:
        """Return the engine's own arrays [N, ...] for `infos`, by name."""

    @abstractmethod
    def _kind(self) -> str:
        """Return a text that identifies this engine's decision process."""

    @abstractmethod
    def _arrays(self) -> Mapping[str, Array]:
        """Return the engine's own arrays [N, ...] that belong to the state besides those of this class, by name."""

    @abstractmethod
    def _check_state(self, state: Mapping[str, Array]) -> None:
        """Raise a `ValueError` for a state that cannot occur; names, shapes and types are already checked."""

    @abstractmethod
    def _generator(self, row: int) -> np.random.Generator:
        """Return a generator that continues the stream of one sub-environment, without changing the stream."""

    @abstractmethod
    def _single(self) -> gymnasium.Env[Array, Any]:
        """Make a single environment, with this engine's render mode."""

    @abstractmethod
    def _load(self, single: gymnasium.Env[Array, Any], row: int) -> None:
        """Set a single environment to the state of one sub-environment, except for its generator."""
