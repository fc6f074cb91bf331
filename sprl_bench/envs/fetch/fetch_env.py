"""One Fetch environment: a sparse, episodic task around a simulation.

Each id has two classes, one for each kind of observation. They only differ in the form of an observation, and in the
methods that compute the reward of other goals in goal mode.
"""

from __future__ import annotations

import inspect
from abc import abstractmethod
from functools import partial
from typing import Any

import gymnasium
import numpy as np
from gymnasium.error import ResetNeeded
from gymnasium.spaces import Box, Dict
from gymnasium_robotics.core import GoalEnv
from numpy.typing import NDArray

from sprl_bench.envs.checks import refuse_unknown
from sprl_bench.envs.fetch.picture import Picture
from sprl_bench.envs.fetch.rules import (
    ACTION_SPACE,
    ARGUMENTS,
    ELSEWHERE,
    Rules,
    check_interface,
    checked_actions,
)
from sprl_bench.envs.fetch.simulation import Observation, new_simulation


def is_reached(achieved: NDArray[np.float64], desired: NDArray[np.float64], threshold: float) -> NDArray[np.bool_]:
    """Return whether the achieved goals [..., 3] are within `threshold` metres of the desired ones [..., 3].

    At exactly the threshold, Gymnasium-Robotics gives the reward but reports no success; here the goal is reached.
    """
    return np.asarray(np.linalg.norm(achieved - desired, axis=-1) <= threshold)


class FetchEnv(gymnasium.Env[Any, NDArray[np.float32]]):
    """The base class of both kinds of observation.

    Args:
        task: `"Reach"`, `"Push"`, `"Slide"` or `"PickAndPlace"`.
        rules: The arguments that change the decision process.
        render_mode: None, `"rgb_array"` or `"human"`.
    """

    metadata: dict[str, Any] = Rules().metadata

    def __init__(self, task: str, rules: Rules, render_mode: str | None) -> None:
        self.task = task
        self.rules = rules
        self.render_mode = render_mode
        self.metadata = rules.metadata
        self.simulation = new_simulation(task, rules.substep)
        self.action_space = Box(ACTION_SPACE.low, ACTION_SPACE.high, dtype=np.float32)
        self._elapsed = 0
        self._observation: Observation = {}
        self._picture: Picture | None = None

    @abstractmethod
    def _shown(self, observation: Observation) -> Any:
        """Return the simulation's observation in the form of this environment, in new arrays."""

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Start an episode. A `seed` determines this and all following episodes."""
        super().reset(seed=seed, options=options)
        self.simulation.np_random = self.np_random
        self._observation, _ = self.simulation.reset()
        self._elapsed = 0
        self._draw_window()
        return self._shown(self._observation), {"is_success": self._is_success()}

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Take one action, cast to float32 and clipped to the box.

        Raises:
            ResetNeeded: No episode has started.
            TypeError, ValueError: The action has a wrong shape or type, or is not finite. No state has changed.
        """
        if not self._observation:
            raise ResetNeeded("step() needs a reset() before it.")
        action = checked_actions(action, (4,))
        applied = self.rules.applied(action[None], [self.np_random])[0]
        observation = self.simulation.step(applied)[0]
        self._elapsed += 1
        if self.simulation.has_diverged:
            return self._diverged(applied)
        self._observation = observation
        self._draw_window()
        is_success = self._is_success()
        terminated = is_success and self.rules.terminate_on_goal
        truncated = self._elapsed >= self.rules.horizon and not terminated
        info = {"is_success": is_success, "applied_action": applied}
        return self._shown(observation), float(is_success), terminated, truncated, info

    def _diverged(self, applied: NDArray[np.float32]) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Return the last step of an episode whose simulation has diverged, with its last valid observation."""
        info = {"is_success": False, "applied_action": applied, "diverged": True}
        return self._shown(self._observation), 0.0, False, True, info

    def _is_success(self) -> bool:
        achieved, desired = self._observation["achieved_goal"], self._observation["desired_goal"]
        return bool(is_reached(achieved, desired, self.simulation.distance_threshold))

    def load(self, saved: dict[str, NDArray[np.float64]], observation: Observation, elapsed: int) -> None:
        """Set the state of a running episode, except for the random generator.

        Args:
            saved: The result of `Simulation.save`.
            observation: The last observation.
            elapsed: Actions taken so far.
        """
        self.simulation.load(saved)
        self._observation, self._elapsed = observation, elapsed

    def render(self) -> Any:
        """Return a picture, uint8 [480, 480, 3], or show it with `"human"`; the simulation does not change."""
        if self.render_mode is None:
            gymnasium.logger.warn(f'{self} has no render mode; make it with render_mode="rgb_array" or "human".')
            return None
        if not self._observation:
            raise ResetNeeded("render() needs a reset() before it.")
        if self._picture is None:
            self._picture = Picture(self.simulation.model)
        saved = self.simulation.save()
        return self._picture.draw(saved["row"], saved["goal"], self.render_mode)

    def _draw_window(self) -> None:
        if self.render_mode == "human":
            self.render()

    def close(self) -> None:
        """Close the window and release the graphics context, if there is one."""
        if self._picture is not None:
            self._picture.close()
            self._picture = None

    def __getstate__(self) -> dict[str, Any]:
        """Exclude the window: a copy opens its own when it is first drawn."""
        return {**self.__dict__, "_picture": None}


class FlatFetch(FetchEnv):
    """
    ## Description

    A Fetch arm with seven joints above a table, controlled by displacements of its gripper, simulated by MuJoCo in
    steps of 2 ms. The tasks and their models are Gymnasium-Robotics' `Fetch*-v4`. They are sparse, as in the paper's
    appendix G.1: reaching the goal gives reward 1 and ends the episode.

    - Reach: bring the gripper to a point in the air.
    - Push: push a box to a point on the table, with closed fingers.
    - Slide: hit a puck so that it slides to a point out of reach and stops there, with closed fingers.
    - PickAndPlace: bring a box to a point on the table or in the air.

    ## Action Space

    `Box(-1, 1, (4,), float32)`: displacement of the gripper along x, y and z, in units of 5 cm, and the opening of
    its fingers (PickAndPlace only). Values outside the box are clipped; NaN, infinity and other shapes are errors.

    ## Observation Space

    `Box(-inf, inf, (16,), float64)` for Reach, `(31,)` for the others: the observation, the achieved goal and the
    desired goal of Gymnasium-Robotics, in this order. Velocities are in metres (radians) per 40 ms, whatever
    `substep` is. With `observation="goal"`, the same three as a dictionary.

    `info` holds `is_success` (bool), after a step `applied_action` (float32, with noise and clipped), and, if the
    simulation has diverged, `diverged` (True).

    ## Rewards

    1 if the achieved goal is within 5 cm of the desired one, else 0.

    ## Starting State

    The arm is above the table. The object lies on the table, at least 10 cm from the gripper. Object and goal are drawn
    again for each episode. The start does not depend on `substep`.

    ## Episode End

    1. Terminated: the goal is reached (unless `terminate_on_goal=False`).
    2. Truncated: round(1000 / substep) actions were taken and the last did not terminate.
    3. Truncated: the simulation diverged; the observation is the last valid one and the reward 0.

    ## Arguments

    - `substep=20`: simulation steps for each action, 1 to 500. Fewer make the reward sparser (appendix A.4).
    - `action_noise=0.0`: standard deviation of Gaussian noise added to an action before it is clipped (appendix A.5).
    - `terminate_on_goal=True`: whether reaching the goal ends the episode.
    - `observation="flat"`: or `"goal"`, a dictionary for hindsight replay, with `compute_reward`.
    - `render_mode`: None, `"rgb_array"` or `"human"`.

    ## Version history

    - v1: first version.
    """  # noqa: D212, D415 - the sections have Gymnasium-Robotics' form

    def __init__(self, task: str, rules: Rules, render_mode: str | None = None) -> None:
        super().__init__(task, rules, render_mode)
        size = sum(space.shape[0] for space in self.simulation.observation_space.values())
        self.observation_space = Box(-np.inf, np.inf, (size,), np.float64)

    def _shown(self, observation: Observation) -> NDArray[np.float64]:
        return np.concatenate([observation[name] for name in ("observation", "achieved_goal", "desired_goal")])


class GoalFetch(FetchEnv, GoalEnv):  # type: ignore[misc]  # upstream is untyped
    """The same task with Gymnasium-Robotics' dictionary of observation, achieved and desired goal."""

    def __init__(self, task: str, rules: Rules, render_mode: str | None = None) -> None:
        super().__init__(task, rules, render_mode)
        spaces = self.simulation.observation_space.spaces
        self.observation_space = Dict(
            {name: Box(-np.inf, np.inf, box.shape, np.float64) for name, box in spaces.items()}
        )

    def _shown(self, observation: Observation) -> Observation:
        return {name: values.copy() for name, values in observation.items()}

    def compute_reward(self, achieved_goal: Any, desired_goal: Any, info: Any) -> NDArray[np.float64]:  # noqa: ARG002 - GoalEnv's API
        """Return the rewards [...] of any achieved and desired goals [..., 3]."""
        return is_reached(achieved_goal, desired_goal, self.simulation.distance_threshold).astype(np.float64)[()]

    def compute_terminated(self, achieved_goal: Any, desired_goal: Any, info: Any) -> Any:  # noqa: ARG002 - as above
        """Return whether reaching these goals [..., 3] would end the episode, bool [...]."""
        reached = is_reached(achieved_goal, desired_goal, self.simulation.distance_threshold)
        return (reached & self.rules.terminate_on_goal)[()]

    def compute_truncated(self, achieved_goal: Any, desired_goal: Any, info: Any) -> Any:
        """Return whether the current step is the last of the horizon and does not terminate, bool [...]."""
        is_last = self._elapsed >= self.rules.horizon
        return is_last & ~np.asarray(self.compute_terminated(achieved_goal, desired_goal, info))


def make_single(
    task: str,
    *,
    substep: int = Rules.substep,
    action_noise: float = Rules.action_noise,
    terminate_on_goal: bool = Rules.terminate_on_goal,
    observation: str = "flat",
    render_mode: str | None = None,
    **unknown: Any,
) -> FetchEnv:
    """Make the environment of a task, with the class for its kind of observation.

    Raises:
        TypeError, ValueError: An argument is unknown or not allowed.
    """
    refuse_unknown(f"Fetch{task}Sparse", unknown, ARGUMENTS, ELSEWHERE)
    check_interface(observation, render_mode)
    kind = FlatFetch if observation == "flat" else GoalFetch
    return kind(task, Rules(substep, action_noise, terminate_on_goal), render_mode)


class _EntryPoint:
    """A callable that makes the environment of one task, with the metadata that Gymnasium reads."""

    metadata = FetchEnv.metadata

    def __init__(self, task: str) -> None:
        self._task = task
        self.__signature__ = inspect.signature(partial(make_single, task))  # for tools that inspect the arguments

    def __call__(self, **arguments: Any) -> FetchEnv:
        return make_single(self._task, **arguments)


reach, push = _EntryPoint("Reach"), _EntryPoint("Push")
slide, pick_and_place = _EntryPoint("Slide"), _EntryPoint("PickAndPlace")
