"""The batched Atari engine: N emulators behind the vector environment that all engines share."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import gymnasium
import numpy as np
from gymnasium.utils.seeding import np_random
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from sprl_bench.envs.atari import atari_env
from sprl_bench.envs.atari.atari_env import AtariEnv
from sprl_bench.envs.atari.emulators import BLOCK, NUM_SEEDS, Emulators
from sprl_bench.envs.atari.preprocessing import HORIZON, METADATA, NUM_ACTIONS, action_space, observation_space
from sprl_bench.envs.discrete_actions import DiscreteActions
from sprl_bench.envs.engine import Array, Rows
from sprl_bench.envs.streams import from_generator, from_generators, to_generator, to_generators
from sprl_bench.envs.vector import BatchedEnv


class AtariEngine(BatchedEnv):
    """N games. The arguments are those of `BatchedEnv`."""

    metadata = METADATA
    single: ClassVar[type[AtariEnv]]

    def __init__(self, num_envs: int = 1, **arguments: Any) -> None:
        super().__init__(
            num_envs,
            single_observation_space=observation_space(),
            single_action_space=action_space(),
            **arguments,
        )
        self._emulators = Emulators(
            self.single.game,
            self.num_envs,
            same_step=self._mode is AutoresetMode.SAME_STEP,
            num_threads=self._threads.count,
        )
        self._actions = DiscreteActions(self.num_envs, NUM_ACTIONS - 1)
        self._generators = [np.random.default_rng(0)] * self.num_envs  # until they are seeded
        self._is_success = np.zeros(self.num_envs, np.bool_)
        self._is_asked = False  # whether the user resets; other restarts are ale-py's own

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Array, dict[str, Any]]:
        """Start new episodes; see `BatchedEnv.reset`."""
        self._is_asked = True
        try:
            return super().reset(seed=seed, options=options)
        finally:
            self._is_asked = False

    def _seed(self, rows: Rows, seeds: list[int]) -> None:
        for row, seed in zip(rows.tolist(), seeds, strict=True):
            self._generators[row], _ = np_random(seed)
        self._emulators.renew(rows)

    def _restart(self, rows: Rows) -> None:
        start = self._emulators.restart if self._is_asked else self._emulators.follow
        start(rows, self._generators)
        self._observations[rows] = self._emulators.newest[rows]
        self._is_success[rows] = False

    def _advance(self, actions: NDArray[np.int64]) -> None:
        is_running = ~self._ended
        outcome = self._emulators.step(actions, is_running)
        self._observations = outcome.observations  # a new array in each step, so no copy is needed
        self._rewards[:] = outcome.rewards * is_running
        self._terminations[:] = outcome.terminated
        self._truncations[:] = (self._elapsed >= HORIZON) & is_running & ~self._terminations
        self._is_success |= self._rewards > 0

    def _checked_actions(self, actions: Any) -> NDArray[np.int64]:
        checked = self._actions.checked(actions, self._ended)
        is_wrong = (checked < 0) | (checked >= NUM_ACTIONS)  # of an ended game; ale-py takes no such action even there
        return np.where(is_wrong, 0, checked)

    def _information(self) -> Mapping[str, Array]:
        return {"is_success": self._is_success}

    def _kind(self) -> str:
        return self.single.game

    def _arrays(self) -> Mapping[str, Array]:
        return {
            "observations": self._observations,
            "is_success": self._is_success,
            "streams": from_generators(self._generators),
            **{f"emulator_{name}": values for name, values in self._emulators.arrays.items()},
        }

    def set_state(self, state: Mapping[str, Array]) -> None:
        """Restore a state from `get_state` of an engine with the same id, arguments and N.

        The running episodes are played again, up to 10,000 steps each.

        Raises:
            ValueError: The state is not from such an engine. No state has changed, unless the replay of the episodes
                gave other observations, as another version of ale-py may.
        """
        super().set_state(state)
        self._generators = to_generators(state["streams"])
        self._emulators.replay()
        if (self._emulators.newest != self._observations).any():
            raise ValueError("state['observations'] differs from the replay; it must be of this version of ale-py.")

    def _check_state(self, state: Mapping[str, Array]) -> None:
        limits = {"seeds": NUM_SEEDS, "episodes": BLOCK, "actions": NUM_ACTIONS, "taken": HORIZON + 1}
        for name, limit in limits.items():
            values = state[f"emulator_{name}"]
            if ((values < 0) | (values >= limit)).any():
                raise ValueError(f"state['emulator_{name}'] is out of range; it must be from 0 to {limit - 1}.")

    def _generator(self, row: int) -> np.random.Generator:
        return to_generator(from_generator(self._generators[row]))

    def _single(self) -> AtariEnv:
        return self.single(render_mode=self.render_mode)

    def _load(self, single: gymnasium.Env[Array, Any], row: int) -> None:
        assert isinstance(single, AtariEnv)
        arrays = {name: values[row : row + 1].copy() for name, values in self._emulators.arrays.items()}
        single.load(arrays, is_success=bool(self._is_success[row]), is_running=not self._ended[row])


class MontezumaRevengeEngine(AtariEngine):
    """N games of Montezuma's Revenge."""

    single = atari_env.MontezumaRevenge


class FreewayEngine(AtariEngine):
    """N games of Freeway."""

    single = atari_env.Freeway


class MsPacmanEngine(AtariEngine):
    """N games of Ms. Pac-Man."""

    single = atari_env.MsPacman


class GravitarEngine(AtariEngine):
    """N games of Gravitar."""

    single = atari_env.Gravitar


class SeaquestEngine(AtariEngine):
    """N games of Seaquest."""

    single = atari_env.Seaquest


class HeroEngine(AtariEngine):
    """N games of H.E.R.O."""

    single = atari_env.Hero
