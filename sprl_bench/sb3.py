"""Our engines, and other vector environments of Gymnasium, for Stable-Baselines3; recorded or not.

    from sprl_bench.sb3 import as_vec_env

    envs = as_vec_env(gymnasium.make_vec("SPRL/FourRooms-7x7-v1", num_envs=12))
    PPO("MlpPolicy", envs).learn(100_000)

`make_vec_env` of Stable-Baselines3 steps single environments one after the other; this steps the engine once.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Final, Literal, get_args

import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv

from sprl_bench.extras import require_extra

if TYPE_CHECKING:
    from stable_baselines3.common.env_util import is_wrapped
    from stable_baselines3.common.vec_env import VecEnv
else:
    VecEnv = require_extra("stable_baselines3.common.vec_env").VecEnv
    is_wrapped = require_extra("stable_baselines3.common.env_util").is_wrapped

Infos = Literal["ends", "all"]
Indices = None | int | Iterable[int]
UNSETTABLE: Final = "attr_name is {!r}, but no attribute can be set: an engine has no separate sub-environments."


def as_vec_env(envs: VectorEnv[Any, Any, Any], *, infos: Infos = "ends") -> GymnasiumVecEnv:
    """Return a vector environment of Gymnasium as one of Stable-Baselines3.

    Rewards are float32, as there. The info of a sub-environment whose episode ended holds its last observation as
    `terminal_observation`, and `TimeLimit.truncated`. Put `VecMonitor` or `VecNormalize` on top as usual.

    Args:
        envs: An engine or a `SyncVectorEnv` of N sub-environments that are reset in the step that ends their episode
            (`"SameStep"`).
        infos: "ends": only steps that end an episode have the environment's info; the others are empty, which is
            faster. "all": every step has it.

    Raises:
        ValueError: The environments are reset at another time, or `infos` is neither.
    """
    return GymnasiumVecEnv(envs, infos)


class GymnasiumVecEnv(VecEnv):
    """See `as_vec_env`."""

    def __init__(self, envs: VectorEnv[Any, Any, Any], infos: Infos) -> None:
        mode = AutoresetMode(envs.metadata.get("autoreset_mode", AutoresetMode.NEXT_STEP))
        if mode is not AutoresetMode.SAME_STEP:
            raise ValueError(f'envs has autoreset_mode="{mode.value}"; it must be "SameStep".')
        if infos not in get_args(Infos):
            raise ValueError(f"infos is {infos!r}; it must be 'ends' or 'all'.")
        self.envs = envs
        self._every_info = infos == "all"
        self._reused = not getattr(envs.unwrapped, "copy", True)  # SyncVectorEnv writes each step into one array
        self._rows = np.arange(envs.num_envs)
        self._actions: Any = None
        super().__init__(envs.num_envs, envs.single_observation_space, envs.single_action_space)

    def seed(self, seed: int | None = None) -> Sequence[int | None]:
        """Seed the next reset; without effect in a run of `sprl-bench run`, which has seeded its environments."""
        super().seed(seed)
        if _is_seeded(self.envs):
            self._reset_seeds()
        return self._seeds

    def reset(self) -> Any:
        """Reset all sub-environments, with the seeds of the last `seed()`, and return their observations [N, ...]."""
        seeds = None if all(seed is None for seed in self._seeds) else list(self._seeds)
        options = next((one for one in self._options if one), None)
        observations, infos = self.envs.reset(seed=seeds, options=options)  # type: ignore[arg-type]  # a list is allowed
        self.reset_infos = _infos_of(infos, self._rows)
        self._reset_seeds()
        self._reset_options()
        return self._owned(observations)

    def step_async(self, actions: np.ndarray) -> None:
        """Keep the actions for `step_wait`."""
        self._actions = actions

    def step_wait(self) -> tuple[Any, np.ndarray, np.ndarray, list[dict[str, Any]]]:
        """Take a step.

        Returns:
            Observations [N, ...], rewards float32 [N], ends bool [N], and N infos.
        """
        observations, rewards, terminated, truncated, infos = self.envs.step(self._actions)
        ended = np.logical_or(terminated, truncated)
        own = self._running(infos)
        (rows,) = ended.nonzero()
        if len(rows):
            finals, firsts = _infos_of(infos["final_info"], rows), _infos_of(infos, rows)
            for row, final, first in zip(rows.tolist(), finals, firsts, strict=True):
                own[row] = {
                    **final,
                    "TimeLimit.truncated": bool(truncated[row] and not terminated[row]),
                    "terminal_observation": infos["final_obs"][row],
                }
                self.reset_infos[row] = first
        return self._owned(observations), np.asarray(rewards, np.float32), ended, own

    def _running(self, infos: Mapping[str, Any]) -> list[dict[str, Any]]:
        """Return the infos of a step, as if it ended no episode."""
        if not self._every_info:
            return [{} for _ in range(self.num_envs)]
        return [{**info, "TimeLimit.truncated": False} for info in _infos_of(infos, self._rows)]

    def close(self) -> None:
        """Close the environments; a recorded run writes its record."""
        self.envs.close()

    def get_attr(self, attr_name: str, indices: Indices = None) -> list[Any]:
        """Return an attribute of the sub-environments; of an engine, of copies of them."""
        if attr_name == "render_mode":
            return [self.envs.render_mode for _ in self._get_indices(indices)]
        return [getattr(self._sub_env(row), attr_name) for row in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: Indices = None) -> None:  # noqa: ARG002
        """Raise an AttributeError: sub-environments cannot be changed one by one."""
        raise AttributeError(UNSETTABLE.format(attr_name))

    def env_method(
        self, method_name: str, *method_args: Any, indices: Indices = None, **method_kwargs: Any
    ) -> list[Any]:
        """Call a method of the sub-environments; of an engine, of copies of them, which are dropped afterwards.

        Rewards of goals do not depend on the state: an engine computes them without a copy, which HER needs often.
        """
        rows = self._get_indices(indices)
        of_all = getattr(self.envs.unwrapped, "compute_reward", None) if method_name == "compute_reward" else None
        if of_all is not None:
            return [of_all(*method_args, **method_kwargs) for _ in rows]
        return [getattr(self._sub_env(row), method_name)(*method_args, **method_kwargs) for row in rows]

    def env_is_wrapped(self, wrapper_class: type[Any], indices: Indices = None) -> list[bool]:
        """Return whether each sub-environment has such a wrapper; those of an engine have none."""
        singles = getattr(self.envs.unwrapped, "envs", None)
        rows = self._get_indices(indices)
        return [singles is not None and is_wrapped(singles[row], wrapper_class) for row in rows]

    def get_images(self) -> list[Any]:
        """Return a frame of each sub-environment."""
        return list(self.envs.render() or ())

    def _owned(self, observations: Any) -> Any:
        """Return observations that the next step does not change: with `copy=False` they are views or one array."""
        if isinstance(observations, Mapping):
            return {name: self._owned(part) for name, part in observations.items()}
        return observations.copy() if self._reused or not observations.flags.writeable else observations

    def _sub_env(self, row: int) -> Any:
        base: Any = self.envs.unwrapped
        return base.sub_env(row) if hasattr(base, "sub_env") else base.envs[row]


def _is_seeded(envs: Any) -> bool:
    """Return whether a recorder, beneath any wrappers, has environments that have their seed already."""
    while not hasattr(envs, "seeded") and hasattr(envs, "env"):
        envs = envs.env
    return bool(getattr(envs, "seeded", False))


def _infos_of(infos: Mapping[str, Any], rows: np.ndarray) -> list[dict[str, Any]]:
    """Return the values of some sub-environments, a dict each; those that one does not have are left out."""
    own: list[dict[str, Any]] = [{} for _ in rows]
    for name, values in infos.items():
        if name.startswith(("_", "final_")):
            continue
        mask = infos.get(f"_{name}")
        column = _column(values, rows)
        for place in range(len(rows)) if mask is None else mask[rows].nonzero()[0].tolist():
            own[place][name] = column[place]
    return own


def _column(values: Any, rows: np.ndarray) -> list[Any]:
    """Return one value of each of some sub-environments; numbers are Python's."""
    if isinstance(values, Mapping):
        return _infos_of(values, rows)
    chosen = values[rows]
    if chosen.ndim == 1 and chosen.dtype != object:
        return chosen.tolist()  # type: ignore[no-any-return]
    return [one.item() if isinstance(one, np.generic) else one for one in chosen]
