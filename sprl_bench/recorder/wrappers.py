"""The recorder: sits directly on the environment, sees its true rewards, and passes everything through unchanged.

Wrappers above it may change rewards, observations and endings without changing a score. So that episodes cannot be
chosen either, recording begins with a reset, and no reset after the first step may have a seed.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Final, SupportsFloat

import gymnasium
import numpy as np
import numpy.typing as npt
from gymnasium.error import ResetNeeded
from gymnasium.vector import AutoresetMode, VectorEnv, VectorWrapper

from sprl_bench.recorder.episodes import EpisodeLog
from sprl_bench.recorder.tape import NoTape

if TYPE_CHECKING:
    Wrapped = VectorWrapper[Any, Any, Any, Any, Any]
else:
    Wrapped = VectorWrapper  # of gymnasium 1.2, it takes no parameters

Mask = npt.NDArray[np.bool_]


class Listener:
    """Receives the events of a recorded environment; this one ignores them."""

    @property
    def recording(self) -> bool:
        """Whether the environment is still recorded."""
        return True

    def stepping(self) -> None:
        """An environment is about to take a step; raise to prevent it."""

    def resetting(self) -> None:
        """A single environment is about to be reset."""

    def completed(self) -> None:
        """The budget is reached."""

    def closed(self) -> None:
        """The environment is about to be closed."""


SILENT: Final = Listener()
NO_TAPE: Final = NoTape()
UNCOPYABLE: Final = "A recorded environment cannot be copied or pickled; record each environment where it is used."
HABIT: Final = (
    "A library may have given it: Stable-Baselines3 does after load(path, env=env); load the model without env, then "
    "call set_env(env)."
)
UNRESET: Final = "A recorded environment must be reset() before its first step, so that no episode is recorded in part."


def _is_new(env: Any) -> bool:
    """Return whether no random stream has begun, so that the seed drawn at the first reset says all that follows."""
    if hasattr(env, "envs"):
        return all(_is_new(single.unwrapped) for single in env.envs)
    return getattr(env, "_np_random", None) is None and not getattr(env, "_is_reset", False)


def _refuse_seed(seed: Any) -> None:
    """Refuse a seed after the first recorded step: repeating one seed would score a single layout.

    Raises:
        ValueError: A seed is given.
    """
    seeds = seed if isinstance(seed, Sequence) else [seed]
    if any(one is not None for one in seeds):
        raise ValueError(
            f"seed is {seed!r}, but recorded steps have been taken, and only a reset() before them may be seeded: "
            f"later episodes continue its random stream. Call reset() without a seed. {HABIT}"
        )


class VectorRecorder(Wrapped):
    """Records a vector environment.

    Args:
        env: A vector environment whose `metadata` names its autoreset mode.
        budget: Environment steps after which nothing is recorded; later steps pass through.
        listener: Receives `completed` and `closed`.
        seeded: Whether the environment already has its seed, so that `reset` refuses another one.
        tape: Keeps the actions and resets until the budget is reached.
    """

    def __init__(
        self,
        env: VectorEnv[Any, Any, Any],
        budget: int,
        listener: Listener = SILENT,
        *,
        seeded: bool = False,
        tape: NoTape = NO_TAPE,
    ) -> None:
        super().__init__(env)
        self.tape = tape
        self._seeded = seeded
        self._unreset = np.full(env.num_envs, not seeded)  # [N]
        self._begun = seeded
        self.episode_log = EpisodeLog(env.num_envs, budget, AutoresetMode(env.metadata["autoreset_mode"]))
        self._listener = listener

    @property
    def _recorded(self) -> bool:
        """Whether what happens now is part of the record."""
        return not self.episode_log.complete and self._listener.recording

    @property
    def seeded(self) -> bool:
        """Whether the environment already has its seed, so that `reset` refuses another one."""
        return self._seeded

    @property
    def autoreset_mode(self) -> AutoresetMode:
        """That of the environment; libraries such as TorchRL ask for it here."""
        return self.episode_log.autoreset

    def reset(self, *, seed: Any = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Reset the environment; the unfinished episodes that this ends count as failures.

        Raises:
            ValueError: A seed is given where the environment has its own, or after the first recorded step.
        """
        if seed is not None and self._seeded:
            raise ValueError(
                f"seed is {seed!r}, but these environments are seeded by the run: call reset() without a seed. {HABIT}"
            )
        if self.episode_log.env_steps and self._recorded:
            _refuse_seed(seed)
        mask = (options or {}).get("reset_mask")  # read first: Gymnasium takes it out of the options
        envs = slice(None) if mask is None else np.array(mask, np.bool_)
        fresh = seed is None and self._unreset.all() and self.tape is not NO_TAPE and _is_new(self.env.unwrapped)
        observations, infos = self.env.reset(seed=seed, options=options)
        if self._recorded:
            self.tape.reset(self.env.np_random_seed if fresh else seed, None if mask is None else envs)
        self._unreset[envs] = False
        self._begun = not self._unreset.any()
        self.episode_log.reset(envs)
        return observations, infos

    def step(self, actions: Any) -> tuple[Any, Any, Any, Any, dict[str, Any]]:
        """Step the environment and log the episodes that end.

        Raises:
            ResetNeeded: It was not reset since recording began.
        """
        if not self._begun:
            raise ResetNeeded(UNRESET)
        self._listener.stepping()
        observations, rewards, terminated, truncated, infos = self.env.step(actions)
        if self._recorded:
            self.tape.step(actions)
        ended = np.logical_or(terminated, truncated)
        if self.episode_log.step(np.asarray(rewards, np.float64), ended, self._success(infos, ended)):
            self._listener.completed()
        return observations, rewards, terminated, truncated, infos

    def _success(self, infos: Mapping[str, Any], ended: Mask) -> Mask:
        """Return which of the episodes that just ended were successful: [N]."""
        if not np.count_nonzero(ended):
            return ended
        source = infos.get("final_info", infos) if self.episode_log.autoreset is AutoresetMode.SAME_STEP else infos
        return np.asarray(source.get("is_success", np.zeros_like(ended))).astype(np.bool_)

    def __getstate__(self) -> Any:
        """Refuse to be copied or pickled: a copy's steps would be recorded twice, or not at all."""
        raise TypeError(UNCOPYABLE)

    def close(self, **kwargs: Any) -> None:
        """Close the environment."""
        self._listener.closed()
        self.env.close(**kwargs)


class EnvRecorder(gymnasium.Wrapper[Any, Any, Any, Any]):
    """Records a single environment as one sub-environment of a log.

    Args:
        env: The environment.
        log: The log of all sub-environments.
        index: Which sub-environment of that log this is.
        listener: Receives all events.
        tape: Keeps the actions and resets until the budget is reached.
    """

    def __init__(
        self,
        env: gymnasium.Env[Any, Any],
        log: EpisodeLog,
        index: int = 0,
        listener: Listener = SILENT,
        *,
        tape: NoTape = NO_TAPE,
    ) -> None:
        super().__init__(env)
        self.episode_log, self._index = log, index
        self.tape = tape
        self._listener = listener
        self._is_reset = self._has_stepped = False

    @property
    def _recorded(self) -> bool:
        """Whether what happens now is part of the record."""
        return not self.episode_log.complete and self._listener.recording

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Reset the environment; an unfinished episode counts as a failure.

        Raises:
            ValueError: A seed is given after the first recorded step.
        """
        if self._has_stepped and self._recorded:
            _refuse_seed(seed)
        self._listener.resetting()
        fresh = seed is None and not self._is_reset and self.tape is not NO_TAPE and _is_new(self.env.unwrapped)
        observation, info = self.env.reset(seed=seed, options=options)
        if self._recorded:
            self.tape.reset(self.env.unwrapped.np_random_seed if fresh else seed, env=self._index)
        self._is_reset = True
        self.episode_log.reset(self._here)
        return observation, info

    def step(self, action: Any) -> tuple[Any, SupportsFloat, bool, bool, dict[str, Any]]:
        """Step the environment and log the episode if it ends.

        Raises:
            ResetNeeded: It was not reset since recording began.
        """
        if not self._is_reset:
            raise ResetNeeded(UNRESET)
        self._listener.stepping()
        observation, reward, terminated, truncated, info = self.env.step(action)
        if self._recorded:
            self.tape.step(action, self._index)
        self._has_stepped = True
        ended = np.array([terminated or truncated])
        success = np.array([bool(info.get("is_success", False))])
        if self.episode_log.step(np.array([float(reward)]), ended, success, self._here):
            self._listener.completed()
        return observation, reward, terminated, truncated, info

    @property
    def _here(self) -> slice:
        return slice(self._index, self._index + 1)

    def __getstate__(self) -> Any:
        """Refuse to be copied or pickled: a copy's steps would be recorded twice, or not at all."""
        raise TypeError(UNCOPYABLE)

    def close(self) -> None:
        """Close the environment; an unfinished episode counts as a failure."""
        if self._recorded:
            self.tape.close(self._index)
        self.episode_log.reset(self._here)
        self._listener.closed()
        self.env.close()
