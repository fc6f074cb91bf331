"""The collector: it steps the vector environment with a policy and records a rollout."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import gymnasium
import numpy as np
import numpy.typing as npt
import torch
from gymnasium.vector import AutoresetMode, VectorEnv
from torch import Tensor

from sprl_baselines.learning.images import image_shape
from sprl_baselines.learning.rollout import Rollout

Array = npt.NDArray[Any]


class Decision(NamedTuple):
    """A policy's actions for N observations, and the values of these observations, if the policy computes them."""

    actions: Tensor  # [N] or [N, A]
    log_probs: Tensor  # [N]
    values: Tensor | None  # [N]


DECIDED = ("actions", "log_probs")
Policy = Callable[[Tensor], Decision]
Values = Callable[[Tensor], Tensor]
"""Takes observations `[B, ...]`, and returns their values `[B]`."""


class Collector:
    """Steps a vector env with a policy. Between rollouts it keeps the last observations.

    Args:
        envs: A vector env with autoreset mode SameStep, so that every step is a transition.
        length: Steps T of a rollout.
        device: Device of the policy and of the rollouts.
        action_noise: Standard deviation of the Gaussian noise added to continuous actions before they are clipped and
            executed. The rollout holds the actions without noise.
        seed: Seed of the noise.
        stack: Number of earlier observations of the episode that are joined to each one, oldest first, along the last
            axis (appendix A.3). At the start of an episode, copies of its first observation take their place.

    Raises:
        ValueError: The autoreset mode is another one, or there is noise and actions are not continuous.
    """

    def __init__(
        self,
        envs: VectorEnv[Any, Any, Any],
        length: int,
        device: torch.device,
        *,
        action_noise: float = 0.0,
        seed: int = 0,
        stack: int = 0,
    ) -> None:
        mode = envs.metadata.get("autoreset_mode")
        if mode != AutoresetMode.SAME_STEP:
            raise ValueError(f"autoreset_mode of the vector env is {mode}; it must be {AutoresetMode.SAME_STEP}.")
        space = envs.single_action_space
        if action_noise and not isinstance(space, gymnasium.spaces.Box):
            raise ValueError(f"Hyperparameter action_noise is {action_noise}; it must be 0 for actions in {space}.")
        self._envs, self._length, self._device = envs, length, device
        self._action_noise, self._generator = action_noise, torch.Generator().manual_seed(seed)
        self._clipped = clipping(space)
        self._stack = stack
        self._observations: Array = np.empty(0)  # [N, ...]
        self._positions: Array = np.empty(0)  # [N, 2] or [N, 0]
        self._taken = 0  # steps of each sub-env

    def reset(self) -> None:
        """Start a new episode in every sub-env, with the seeds that the envs already have."""
        first, infos = self._envs.reset()
        self._observations = self._alone(first)
        self._positions = self._position(infos)

    def collect(self, policy: Policy, values: Values | None = None) -> Rollout:
        """Take T steps with `policy`, called under `torch.inference_mode`.

        Args:
            policy: Chooses the actions.
            values: Computes the values of all observations after the last step, if the policy does not.
        """
        tape = _Tape()
        with torch.inference_mode():
            for _ in range(self._length):
                decision = policy(torch.from_numpy(self._observations).to(self._device))
                self._step(decision, tape)
        return tape.rollout(self._observations, self._positions, self._device, values)

    def _step(self, decision: Decision, tape: _Tape) -> None:
        """Take one step in every sub-env, and store it on the tape."""
        actions = self._clipped(self._perturbed(decision.actions.cpu()).numpy())
        seen = self._observations.copy(), self._positions.copy()  # some envs later change these arrays in place
        following, rewards, terminated, truncated, infos = self._envs.step(actions)
        self._taken += 1
        _refuse_not_finite(following, self._taken)
        tape.steps.append((*seen, rewards.copy(), terminated.copy(), truncated.copy()))
        tape.decisions.append(decision)
        before, ended = seen[0], terminated | truncated
        self._observations, self._positions = self._joined(before, following), self._position(infos)
        if ended.any():
            self._observations[ended] = self._alone(following[ended])
            final = np.stack(infos["final_obs"][ended])
            tape.final_observations.extend(self._joined(before[ended], final))
            tape.final_positions.extend(self._position(infos["final_info"])[ended])

    def _joined(self, before: Array, following: Array) -> Array:
        """Append new observations to stacked ones and drop the oldest, `[B, ...]`; a copy."""
        return np.concatenate((before[..., following.shape[-1] :], following), axis=-1)

    def _alone(self, first: Array) -> Array:
        """Stack copies of the first observations of episodes, `[B, ...]`; a copy."""
        return np.tile(first, self._stack + 1)

    def _perturbed(self, actions: Tensor) -> Tensor:
        """Add the action noise."""
        if not self._action_noise:
            return actions
        return actions + self._action_noise * torch.randn(actions.shape, generator=self._generator)

    def _position(self, infos: Mapping[str, Any]) -> Array:
        """Return the (x, y) that a grid env reports, `[N, 2]`; `[N, 0]` for other envs."""
        position: Array = infos.get("position", np.empty((self._envs.num_envs, 0), dtype=np.int64))
        return position

    def state_dict(self) -> dict[str, Any]:
        """Return the last observations and positions, and the noise generator's state."""
        return {
            "observations": self._observations.copy(),
            "positions": self._positions.copy(),
            "taken": self._taken,
            "generator": self._generator.get_state(),
        }

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Restore such a state. It replaces a reset."""
        self._observations, self._positions = np.array(state["observations"]), np.array(state["positions"])
        self._taken = int(state["taken"])
        self._generator.set_state(state["generator"].cpu())


class _Tape:
    """Single steps, stacked into a rollout at the end."""

    def __init__(self) -> None:
        self.steps: list[tuple[Array, ...]] = []
        self.decisions: list[Decision] = []
        self.final_observations: list[Array] = []
        self.final_positions: list[Array] = []

    def rollout(
        self, last_observations: Array, last_positions: Array, device: torch.device, values_of: Values | None
    ) -> Rollout:
        """Return the rollout, with tensors on `device`."""
        observations, positions, rewards, terminated, truncated = map(np.stack, zip(*self.steps, strict=True))
        actions, log_probs = (torch.stack([getattr(one, name) for one in self.decisions]) for name in DECIDED)
        next_positions = np.concatenate((positions[1:], last_positions[None]))
        if self.final_positions:
            next_positions[terminated | truncated] = self.final_positions
        final_observations = np.array(self.final_observations, dtype=observations.dtype)

        def tensor(array: Array) -> Tensor:
            return torch.from_numpy(array).to(device)

        return Rollout(
            observations=tensor(observations),
            actions=actions.clone(),
            rewards=tensor(rewards.astype(np.float32)),
            terminated=tensor(terminated),
            truncated=tensor(truncated),
            values=self._values(tensor(observations), values_of),
            log_probs=log_probs.clone(),
            last_observations=tensor(last_observations.copy()),
            final_observations=tensor(final_observations.reshape(-1, *observations.shape[2:])),
            positions=tensor(positions),
            next_positions=tensor(next_positions),
        )

    def _values(self, observations: Tensor, values_of: Values | None) -> Tensor:
        """Return the values of the observations, `[T, N]`: the policy's, or those of one pass over the rollout."""
        if values_of is None:
            return torch.stack([one.values for one in self.decisions if one.values is not None]).clone()
        with torch.inference_mode():
            values = values_of(observations.flatten(0, 1))
        return values.clone().view(observations.shape[:2])


def _refuse_not_finite(observations: Array, step: int) -> None:
    """Stop at an observation that holds a number that is not finite, before anything learns from it.

    Raises:
        ValueError: One does; the message names the sub-env and its step.
    """
    if observations.dtype.kind == "f" and not np.isfinite(observations).all():
        rows = np.isfinite(observations.reshape(len(observations), -1)).all(axis=1)
        env = int(np.flatnonzero(~rows)[0])
        raise ValueError(f"The observation of sub-environment {env} after its step {step} is not finite.")


def clipping(space: gymnasium.Space[Any]) -> Callable[[Array], Array]:
    """Return a function that clips continuous actions to the box of the space; it does not change discrete ones."""
    if isinstance(space, gymnasium.spaces.Box):
        low, high = space.low, space.high
        return lambda actions: np.clip(actions, low, high)
    return lambda actions: actions


def stacked(space: gymnasium.Space[Any], stack: int) -> gymnasium.Space[Any]:
    """Return the space of observations that are joined with `stack` earlier ones.

    Raises:
        ValueError: The observations are not arrays, so they cannot be joined.
    """
    if stack == 0:
        return space
    if not isinstance(space, gymnasium.spaces.Box):
        raise ValueError(f"Hyperparameter stack is {stack}; it must be 0 for observations in {space}.")
    if (image := image_shape(space)) and image.channels_first:
        raise ValueError(f"Hyperparameter stack is {stack}; it must be 0 for images with channels first, {space}.")
    low, high = (np.tile(bound, stack + 1) for bound in (space.low, space.high))
    return gymnasium.spaces.Box(low, high, dtype=space.dtype.type)
