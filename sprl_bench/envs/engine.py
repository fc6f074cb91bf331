"""What a batched engine is: the arrays of N sub-environments, and the functions that change them.

An engine brings the dynamics of its task and nothing else; ``BatchedEnv`` makes a vector environment of it.
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
    """N copies of one environment, held as arrays; what has to be added for each task is abstract."""

    grain: ClassVar[int] = 1
    """The least number of sub-environments worth a thread."""

    _observations: Array  # [N, ...], current; filled by _restart and _advance
    _rewards: NDArray[np.float64]  # [N]
    _terminations: Mask  # [N]
    _truncations: Mask  # [N]
    _elapsed: Rows  # [N] steps of the running episode
    _ended: Mask  # [N] episode over and not yet restarted; stays False under SameStep
    _seeds: list[int | None]  # [N], None for one that has never been seeded
    _is_reset: bool

    def _allocate(self) -> None:
        """Make the arrays, for ``num_envs`` and ``single_observation_space``."""
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
        """Seed the streams of the sub-environments ``rows`` as ``gymnasium.utils.seeding.np_random`` would."""

    @abstractmethod
    def _restart(self, rows: Rows) -> None:
        """Start a new episode in the sub-environments ``rows``: their observations and information."""

    @abstractmethod
    def _advance(self, actions: Array) -> None:
        """Step each sub-environment that has not ended: observations, information, rewards and flags.

        The others get reward 0 and no flag. ``_elapsed`` already counts the step.
        """

    @abstractmethod
    def _checked_actions(self, actions: Any) -> Array:
        """Return the actions as ``_advance`` takes them, or raise with nothing changed."""

    @abstractmethod
    def _information(self) -> Mapping[str, Array]:
        """Return the live arrays [N, ...] behind ``infos``, by name."""

    @abstractmethod
    def _kind(self) -> str:
        """Return what tells this engine's decision process from others."""

    @abstractmethod
    def _arrays(self) -> Mapping[str, Array]:
        """Return the live arrays [N, ...] that, with those of this class, make up the state, by name."""

    @abstractmethod
    def _check_state(self, state: Mapping[str, Array]) -> None:
        """Refuse arrays, of the right names, shapes and types, that the engine could not have been in."""

    @abstractmethod
    def _generator(self, row: int) -> np.random.Generator:
        """Return a generator that would continue the stream of one sub-environment; the stream stays as it is."""

    @abstractmethod
    def _single(self) -> gymnasium.Env[Array, Any]:
        """Make a single environment, with this engine's render mode."""

    @abstractmethod
    def _load(self, single: gymnasium.Env[Array, Any], row: int) -> None:
        """Put a single environment into the state of one sub-environment, all but its generator."""
