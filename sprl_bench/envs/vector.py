"""The vector environment around a batched engine: everything but the dynamics.

A `BatchedEnv` of N sub-environments returns exactly the values that `SyncVectorEnv` returns for N single environments.
Automatic resets, seeds, masked resets, time limits and infos are implemented here, once for all engines. An engine adds
the arrays and the three functions that change them: seed, restart, advance.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from typing import Any, Final

import gymnasium
import numpy as np
from gymnasium.envs.registration import EnvSpec
from gymnasium.error import ResetNeeded
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space

from sprl_bench.envs.checks import (
    NEVER,
    VECTOR_ARGUMENTS,
    check_array,
    check_choice,
    check_entries,
    check_integer,
    checked_autoreset_mode,
    checked_mask,
    checked_time_limit,
    refuse_unknown,
)
from sprl_bench.envs.engine import Array, Engine, Mask, Rows
from sprl_bench.envs.seeds import checked_seeds, pack_seeds, random_seed, unpack_seeds
from sprl_bench.envs.threads import Threads

_NO_THREADS: Final = Threads(1, grain=1)


class BatchedEnv(Engine):
    """N copies of one environment, stored and stepped as arrays.

    Args:
        num_envs: Number of sub-environments N.
        autoreset_mode: `"SameStep"`, `"NextStep"` or `"Disabled"`, or Gymnasium's enum.
        num_threads: The largest number of threads of a step; None for the number of usable cores. Results do not
            depend on it.
        max_episode_steps: An additional time limit, like Gymnasium's `TimeLimit`; None or -1 for none.
        render_mode: None, `"rgb_array"` or `"human"`.
        copy: Whether observations are returned as copies. False returns a read-only view of the engine's own array,
            which the next step changes in place.

    Raises:
        TypeError, ValueError: An argument is unknown or not allowed.
    """

    metadata: dict[str, Any]
    _threads: Threads = _NO_THREADS
    _viewer: gymnasium.Env[Array, Any] | None = None
    _spec: EnvSpec | None = None

    def __init__(
        self,
        num_envs: int = 1,
        *,
        single_observation_space: gymnasium.Space[Any],
        single_action_space: gymnasium.Space[Any],
        autoreset_mode: str | AutoresetMode = "SameStep",
        num_threads: int | None = None,
        max_episode_steps: int | None = None,
        render_mode: str | None = None,
        copy: bool = True,
        **unknown: Any,
    ) -> None:
        refuse_unknown(type(self).__name__, unknown, VECTOR_ARGUMENTS)
        self.num_envs = check_integer("num_envs", num_envs, 1)
        self._mode = checked_autoreset_mode(autoreset_mode)
        self._limit = checked_time_limit(max_episode_steps)
        check_choice("render_mode", render_mode, [None, *self.metadata["render_modes"]])
        check_choice("copy", copy, [True, False])
        self.render_mode = render_mode
        self.metadata = {**self.metadata, "autoreset_mode": self._mode}
        self.single_observation_space = single_observation_space
        self.single_action_space = single_action_space
        self.observation_space = batch_space(single_observation_space, self.num_envs)
        self.action_space = batch_space(single_action_space, self.num_envs)
        self._copy = copy
        self._threads = Threads(num_threads, self.grain)
        self._allocate()
        self._everyone = np.ones(self.num_envs, np.bool_)

    @property
    def autoreset_mode(self) -> AutoresetMode:
        """When a sub-environment is reset; under the name that `SyncVectorEnv` has for it."""
        return self._mode

    def reset(
        self,
        *,
        seed: int | Sequence[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[Array, dict[str, Any]]:
        """Start a new episode in every sub-environment, or in those selected by `options["reset_mask"]`.

        Args:
            seed: An int seeds sub-environment i with `seed + i`. A list has a seed for each, or None to continue its
                stream. None continues all streams.
            options: `"reset_mask"`, a bool array [N] with at least one True; other options are ignored.

        Returns:
            Observations [N, ...] of all sub-environments, and the infos of those that were reset.

        Raises:
            TypeError, ValueError: A seed or the mask is not allowed. No state has changed.
            ResetNeeded: The mask leaves out a sub-environment that has never been reset.
        """
        mask = checked_mask(options, self.num_envs, first=not self._is_reset)
        rows = np.flatnonzero(mask)
        self._apply_seeds(rows, checked_seeds(seed, rows, self.num_envs))
        self._begin(rows)
        self._ended[rows] = False
        self._is_reset = True
        self._draw_window()
        return self._current_observations(), self._infos(mask, rows)

    def step(self, actions: Any) -> tuple[Array, Array, Array, Array, dict[str, Any]]:
        """Take one action in every sub-environment.

        Returns:
            Observations [N, ...], rewards float64 [N], terminations bool [N], truncations bool [N], infos. All are
            new arrays (the observations under `copy=True`).

        Raises:
            ResetNeeded: No episode is running, or under `"Disabled"` one has ended and was not reset.
            TypeError, ValueError: An action is not allowed. After any of these errors, no state has changed.
        """
        self._check_running()
        actions = self._checked_actions(actions)
        self._elapsed += 1
        if self._mode is AutoresetMode.NEXT_STEP:
            self._begin(np.flatnonzero(self._ended))
        self._advance(actions)
        if self._limit != NEVER:
            self._truncations |= self._elapsed >= self._limit
        ended = self._terminations | self._truncations
        finals = self._same_step(ended) if self._mode is AutoresetMode.SAME_STEP else self._later(ended)
        self._draw_window()
        return (
            self._current_observations(),
            self._rewards.copy(),
            self._terminations.copy(),
            self._truncations.copy(),
            finals | self._all_infos(),
        )

    def _same_step(self, ended: Mask) -> dict[str, Any]:
        """Restart the ended sub-environments; return their final observations and infos."""
        (rows,) = ended.nonzero()
        if not len(rows):
            return {}
        final_obs = np.empty(self.num_envs, dtype=object)
        for row, observation in zip(rows.tolist(), self._shown(self._observations[rows]), strict=True):
            final_obs[row] = observation
        finals = {"final_obs": final_obs, "final_info": self._infos(ended, rows)}
        self._begin(rows)
        return finals | {"_final_obs": ended, "_final_info": ended.copy()}

    def _later(self, ended: Mask) -> dict[str, Any]:
        """Mark the ended sub-environments; the next step or the user restarts them."""
        self._ended = ended
        return {}

    def _begin(self, rows: Rows) -> None:
        if len(rows):
            self._elapsed[rows] = 0
            self._restart(rows)

    def _infos(self, mask: Mask, rows: Rows) -> dict[str, Any]:
        """Return the information of the masked sub-environments (`rows`), zero elsewhere, each with its mask."""
        infos: dict[str, Any] = {}
        for name, values in self._information().items():
            infos[name] = np.zeros(values.shape, values.dtype)
            infos[name][rows] = values[rows]
            infos[f"_{name}"] = mask.copy()
        return infos

    def _all_infos(self) -> dict[str, Any]:
        """Return the information of all sub-environments."""
        infos: dict[str, Any] = {}
        for name, values in self._information().items():
            infos[name] = values.copy()
            infos[f"_{name}"] = self._everyone.copy()
        return infos

    def _shown(self, observations: Array) -> Array:
        """Return what an agent sees of the engine's own observations [K, ...]; a task may have several forms."""
        return observations

    def _current_observations(self) -> Array:
        shown = self._shown(self._observations)
        if self._copy:
            return shown.copy() if np.may_share_memory(shown, self._observations) else shown
        held = shown.view()
        held.flags.writeable = False
        return held

    def _check_running(self) -> None:
        if not self._is_reset:
            raise ResetNeeded("step() needs a reset() before it.")
        if self._mode is AutoresetMode.DISABLED and self._ended.any():
            raise ResetNeeded(
                "With autoreset_mode='Disabled', step() needs a reset() of the sub-environments whose episode is "
                f"over: {np.flatnonzero(self._ended).tolist()}. Use options={{'reset_mask': ...}}."
            )

    # Seeds and streams.

    def _apply_seeds(self, rows: Rows, seeds: list[int | None]) -> None:
        """Seed `rows`; a sub-environment without a seed that never had one gets a random seed."""
        fresh = {
            int(row): random_seed() if seed is None else seed
            for row, seed in zip(rows, seeds, strict=True)
            if seed is not None or self._seeds[row] is None
        }
        if fresh:
            self._seed(np.array(list(fresh), np.int64), list(fresh.values()))
        for row, value in fresh.items():
            self._seeds[row] = value

    def _seed_all(self) -> None:
        self._apply_seeds(np.arange(self.num_envs), [None] * self.num_envs)

    @property
    def np_random_seed(self) -> tuple[int, ...]:  # type: ignore[override]  # as SyncVectorEnv does
        """The seed of each sub-environment."""
        self._seed_all()
        return tuple(seed for seed in self._seeds if seed is not None)

    @property  # type: ignore[misc]  # read-only, as SyncVectorEnv's
    def np_random(self) -> tuple[np.random.Generator, ...]:  # type: ignore[override]  # as SyncVectorEnv does
        """A generator for each sub-environment, in its current state. Drawing from it does not change the stream."""
        self._seed_all()
        return tuple(self._generator(row) for row in range(self.num_envs))

    # State.

    def get_state(self) -> dict[str, Array]:
        """Return copies of all arrays, from which `set_state` continues exactly.

        Raises:
            ResetNeeded: There was no reset yet.
        """
        if not self._is_reset:
            raise ResetNeeded("get_state() needs a reset() before it.")
        copies = {name: values.copy() for name, values in self._all_arrays().items()}
        return copies | {"seeds": pack_seeds(self.np_random_seed), "kind": self._kind_digest()}

    def set_state(self, state: Mapping[str, Array]) -> None:
        """Restore a state from `get_state` of an engine with the same id, arguments and N.

        Raises:
            ValueError: The state is not from such an engine. No state has changed.
        """
        arrays = self._all_arrays()
        check_entries("state", state, [*arrays, "seeds", "kind"])
        check_array("state['kind']", state["kind"], (1,), np.dtype(np.uint64))
        if (state["kind"] != self._kind_digest()).any():
            raise ValueError(f"state['kind'] is that of another task; it must be that of this engine, {self._kind()}.")
        for name, values in arrays.items():
            check_array(f"state[{name!r}]", state[name], values.shape, values.dtype)
        seeds = state["seeds"]
        num_limbs = np.shape(seeds)[-1] if np.shape(seeds) else 0
        check_array("state['seeds']", seeds, (self.num_envs, num_limbs), np.dtype(np.uint64))
        if (state["elapsed"] < 0).any():
            raise ValueError("state['elapsed'] is negative in places; it must be at least 0.")
        if self._mode is AutoresetMode.SAME_STEP and state["ended"].any():
            raise ValueError("state['ended'] is True in places; it must be all False with autoreset_mode='SameStep'.")
        self._check_state(state)
        for name, values in arrays.items():
            values[...] = state[name]
        self._seeds = list(unpack_seeds(seeds))
        self._is_reset = True

    def _kind_digest(self) -> Array:
        """Return a hash of the decision process, uint64 [1]."""
        return np.frombuffer(hashlib.sha256(self._kind().encode()).digest()[:8], "<u8").astype(np.uint64)

    def _all_arrays(self) -> dict[str, Array]:
        return {"elapsed": self._elapsed, "ended": self._ended, **self._arrays()}

    # Pictures, and one sub-environment at a time.

    def sub_env(self, row: int) -> gymnasium.Env[Array, Any]:
        """Return a single environment in the state of one sub-environment, including its random stream.

        It is a copy: changing it does not change the engine.
        """
        row = check_integer("row", row, 0, self.num_envs - 1)
        single = self._single()
        if self._is_reset:
            self._load(single, row)
        self._seed_all()
        single.unwrapped.np_random = self._generator(row)
        single.unwrapped._np_random_seed = self._seeds[row]
        return single

    def call(self, name: str, *args: Any, **kwargs: Any) -> tuple[Any, ...]:
        """Return an attribute, or the result of a method, of a copy of each sub-environment.

        A method that changes its environment only changes the copy.
        """
        attributes = [getattr(self.sub_env(row), name) for row in range(self.num_envs)]
        return tuple(value(*args, **kwargs) if callable(value) else value for value in attributes)

    def get_attr(self, name: str) -> tuple[Any, ...]:
        """Return an attribute of a copy of each sub-environment."""
        return self.call(name)

    def set_attr(self, name: str, values: Any) -> None:  # noqa: ARG002 - Gymnasium's signature
        """Raise an error: sub-environments are rows of arrays, which only `set_state` can change."""
        raise AttributeError(f"{type(self).__name__} cannot set {name!r}; use set_state() for its arrays.")

    def render(self) -> tuple[Any, ...]:
        """Return one frame for each sub-environment (None in human mode or without a render mode)."""
        if not self._is_reset:
            raise ResetNeeded("render() needs a reset() before it.")
        if self.render_mode is None:
            gymnasium.logger.warn(f'{self} has no render mode; make it with render_mode="rgb_array" or "human".')
            return (None,) * self.num_envs
        return tuple(self._frame(row) for row in range(self.num_envs))

    def _frame(self, row: int) -> Any:
        if self._viewer is None:
            self._viewer = self._single()
        self._load(self._viewer, row)
        return self._viewer.render()

    def _draw_window(self) -> None:
        if self.render_mode == "human":
            self.render()

    def close_extras(self, **kwargs: Any) -> None:  # noqa: ARG002 - Gymnasium's signature
        """Stop the threads and close the window, if there are any."""
        self._threads.close()
        if self._viewer is not None:
            self._viewer.close()

    @property
    def spec(self) -> EnvSpec | None:  # make_vec sets it; the setter makes it serialisable
        """The spec of this engine. Enums among its arguments are stored as strings, so it can be serialised."""
        return self._spec

    @spec.setter
    def spec(self, spec: EnvSpec | None) -> None:
        if spec is not None:
            plain = {name: value.value for name, value in spec.kwargs.items() if isinstance(value, AutoresetMode)}
            spec.kwargs.update(plain)
        self._spec = spec
