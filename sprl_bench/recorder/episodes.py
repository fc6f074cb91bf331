"""The log of finished episodes, from which every score is computed.

Environment steps are counted in the order in which they are taken: vector step by vector step, and within one by
sub-environment. An episode's stamp is the number of its last step, so with N sub-environments that all step an episode
that ends at vector step t (from 1) in sub-environment i has stamp (t - 1) N + i + 1. Calls that only reset are not
counted, and nothing beyond the budget is scored.

An episode that is reset before its end counts as a failure, with the return it had: otherwise an agent could raise its
score by resetting bad episodes. Episodes that are unfinished at the budget are dropped.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np
import numpy.typing as npt
from gymnasium.error import ResetNeeded
from gymnasium.vector import AutoresetMode

EPISODE: Final = np.dtype(
    [("stamp", np.int64), ("env", np.int32), ("return", np.float64), ("length", np.int32), ("success", np.bool_)]
)
"""One finished episode: stamp and length in environment steps, env the index of its sub-environment."""

ARRAYS: Final = ("sums", "lost", "lengths", "stamps", "over")  # of a log's state
ALL: Final = slice(None)

Mask = npt.NDArray[np.bool_]
Floats = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]


class EpisodeLog:
    """Counts environment steps and logs each finished episode, for any number of sub-environments.

    Returns are summed with compensation for rounding, so they do not depend on the order or the number of rewards.

    Args:
        num_envs: Number of sub-environments N.
        budget: Environment steps after which nothing is logged any more.
        autoreset: When a sub-environment is reset; under `DISABLED`, a step after an episode's end is an error.
    """

    def __init__(self, num_envs: int, budget: int, autoreset: AutoresetMode = AutoresetMode.SAME_STEP) -> None:
        self.budget, self.autoreset = budget, autoreset
        self.env_steps = 0
        self.abandoned = 0  # episodes that were reset before their end, and logged as failures
        self._may_be_over = autoreset is not AutoresetMode.SAME_STEP
        self._allocate(num_envs)
        self._rows = np.empty(1024, EPISODE)
        self._count = 0

    def _allocate(self, num_envs: int) -> None:
        self.num_envs = num_envs
        self._sums = np.zeros(num_envs)  # [N], of the running episode's rewards
        self._lost = np.zeros(num_envs)  # [N], rounding errors of those sums
        self._lengths = np.zeros(num_envs, np.int64)  # [N]
        self._stamps = np.zeros(num_envs, np.int64)  # [N], of the last step that each has taken; 0 for none
        self._over = np.zeros(num_envs, np.bool_)  # [N], ended and not yet reset
        self._numbers = np.arange(1, num_envs + 1)  # of the steps within one call, if each sub-environment takes one

    def add_env(self) -> int:
        """Add one sub-environment, before the first step, and return its index."""
        self._allocate(self.num_envs + 1)
        return self.num_envs - 1

    @property
    def num_stepped(self) -> int:
        """How many of the sub-environments have taken a step."""
        return int(np.count_nonzero(self._stamps))

    @property
    def complete(self) -> bool:
        """Whether the budget is reached."""
        return self.env_steps >= self.budget

    @property
    def episodes(self) -> npt.NDArray[Any]:
        """All finished episodes within the budget, by stamp: [E] of `EPISODE`."""
        rows = self._rows[: self._count]
        within = rows[rows["stamp"] <= self.budget]
        within = within[np.argsort(within["stamp"])]  # an abandoned one is logged later than it ended
        within["env"] = (np.cumsum(self._stamps > 0) - 1)[within["env"]]  # among those that have taken a step
        return within

    def step(self, rewards: Floats, ended: Mask, success: Mask, envs: slice = ALL) -> bool:
        """Count one call of `step` and log the episodes that it ended; once the budget is reached, do nothing.

        Args:
            rewards: [K], the environment's own.
            ended: [K], terminated or truncated.
            success: [K], read where `ended`.
            envs: Which K of the N sub-environments were stepped.

        Returns:
            Whether this call reached the budget.

        Raises:
            ResetNeeded: A step was taken after the end of an episode, without autoreset.
            ValueError: An episode's return is not finite.
        """
        if self.complete:
            return False
        stepped: Mask | bool = True
        numbers = self._numbers[: len(rewards)]
        if self._may_be_over and np.count_nonzero(self._over[envs]):
            stepped = self._without_resets(envs)
            numbers = np.cumsum(stepped)
            rewards, ended = np.where(stepped, rewards, 0.0), ended & stepped
        lengths = self._lengths[envs]
        lengths += stepped
        self._stamps[envs] = self.env_steps + numbers
        if np.count_nonzero(rewards):
            self._add(rewards, envs)
        if np.count_nonzero(ended):
            places = np.flatnonzero(ended)
            indices = places + (envs.start or 0)
            self._log(indices, success[places])
            self._over[indices] = self._may_be_over
        self.env_steps += int(numbers[-1])
        return self.complete

    def _without_resets(self, envs: slice) -> Mask:
        """Return which of `envs` the call stepped instead of resetting; afterwards none is over."""
        if self.autoreset is not AutoresetMode.NEXT_STEP:
            raise ResetNeeded("A recorded episode is over; reset its environment before the next step.")
        stepped = ~self._over[envs]
        self._over[envs] = False
        return stepped

    def _add(self, rewards: Floats, envs: slice) -> None:
        """Add to the sums and to their rounding errors: the exact error of a floating-point sum is itself a float."""
        before = self._sums[envs]
        after = before + rewards
        part = after - before
        self._lost[envs] += (before - (after - part)) + (rewards - part)
        self._sums[envs] = after

    def _log(self, indices: Indices, success: Mask) -> None:
        """Log the episodes that ended in these K sub-environments with their last step; success is [K]."""
        rows = self._room_for(len(indices))
        rows["stamp"] = self._stamps[indices]
        rows["env"] = indices
        rows["return"] = self._sums[indices] + self._lost[indices]
        rows["length"] = self._lengths[indices]
        rows["success"] = success
        self._forget(indices)
        if not np.isfinite(rows["return"]).all():
            raise ValueError(f"An episode's return is {rows['return']}; rewards must be finite.")
        self._count += len(indices)

    def _room_for(self, count: int) -> npt.NDArray[Any]:
        needed = self._count + count
        if needed > len(self._rows):
            grown = np.empty(max(needed, 2 * len(self._rows)), EPISODE)
            grown[: self._count] = self._rows[: self._count]
            self._rows = grown
        return self._rows[self._count : needed]

    def _forget(self, envs: slice | Indices | Mask) -> None:
        self._sums[envs] = 0.0
        self._lost[envs] = 0.0
        self._lengths[envs] = 0

    def reset(self, envs: slice | Indices | Mask = ALL) -> None:
        """Log the unfinished episodes of the sub-environments that were reset from outside; `envs` may be a mask [N].

        Raises:
            ValueError: The return of an unfinished episode is not finite.
        """
        indices = np.arange(self.num_envs)[envs]
        begun = indices[self._lengths[indices] > 0]
        if len(begun) and not self.complete:
            self.abandoned += len(begun)
            self._log(begun, np.zeros(len(begun), np.bool_))
        self._forget(envs)
        self._over[envs] = False

    @property
    def num_logged(self) -> int:
        """How many episodes have been logged."""
        return self._count

    def logged_since(self, number: int) -> npt.NDArray[Any]:
        """Return all logged episodes but the first `number`, in the order in which they were logged."""
        return self._rows[number : self._count].copy()

    def state_dict(self) -> dict[str, Any]:
        """Return all that later records depend on."""
        rows = self._rows[: self._count]
        return {
            "env_steps": self.env_steps,
            "abandoned": self.abandoned,
            **{name: getattr(self, f"_{name}").copy() for name in ARRAYS},
            "episodes": {name: rows[name].copy() for name in EPISODE.names or ()},
        }

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Take such a state of a log with the same number of sub-environments.

        Raises:
            ValueError: That number differs, or a value cannot be that of such a log.
        """
        if len(state["sums"]) != self.num_envs:
            raise ValueError(f"The state is of {len(state['sums'])} sub-environments; this log has {self.num_envs}.")
        for name in ARRAYS:
            if np.shape(state[name]) != (self.num_envs,):
                raise ValueError(f"{name} has the shape {np.shape(state[name])}; it must be ({self.num_envs},).")
        self._check_ranges(state)
        self.env_steps, self.abandoned = int(state["env_steps"]), int(state["abandoned"])
        for name in ARRAYS:
            setattr(self, f"_{name}", np.array(state[name]))
        columns = state["episodes"]
        self._count = len(columns["stamp"])
        self._rows = np.empty(max(1024, self._count), EPISODE)
        for name in EPISODE.names or ():
            self._rows[name][: self._count] = columns[name]

    def _check_ranges(self, state: Mapping[str, Any]) -> None:
        """Refuse steps beyond the budget, and episodes of no sub-environment or after the last step."""
        steps, episodes = int(state["env_steps"]), state["episodes"]
        for name, values, most in (
            ("env_steps", steps, self.budget + self.num_envs),
            ("an episode's env", episodes["env"], self.num_envs - 1),
            ("an episode's stamp", episodes["stamp"], steps),
        ):
            if np.size(values) and not 0 <= np.min(values) <= np.max(values) <= most:
                raise ValueError(f"{name} is outside of 0 to {most}")
