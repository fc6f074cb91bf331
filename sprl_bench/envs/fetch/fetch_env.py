"""One Fetch environment: a sparse, ending task around a simulation that it holds.

Two classes stand behind each id, one for each kind of observation. They share everything but what an observation
looks like, and that the goal mode can price a goal after the fact.
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
    """Return whether the achieved goals [..., 3] are within ``threshold`` metres of the desired ones [..., 3].

    At exactly the threshold upstream pays the reward but reports no success; here the goal is reached.
    """
    return np.asarray(np.linalg.norm(achieved - desired, axis=-1) <= threshold)


class FetchEnv(gymnasium.Env[Any, NDArray[np.float32]]):
    """What both kinds of observation share.

    Args:
        task: ``"Reach"``, ``"Push"``, ``"Slide"`` or ``"PickAndPlace"``.
        rules: The arguments that change the decision process.
        render_mode: None, ``"rgb_array"`` or ``"human"``.
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
        """Return the simulation's observation as this environment shows it, in arrays of its own."""

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Start an episode; with a ``seed``, the whole stream of episodes becomes a function of it."""
        super().reset(seed=seed, options=options)
        self.simulation.np_random = self.np_random
        self._observation, _ = self.simulation.reset()
        self._elapsed = 0
        self._draw_window()
        return self._shown(self._observation), {"is_success": self._is_success()}

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Take one action, cast to float32 and clipped to the box.

        Raises:
            ResetNeeded: No episode has begun.
            TypeError, ValueError: The action has a wrong shape or type, or is not finite; nothing has changed.
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
        """Return the end of an episode whose simulation has broken down: its last sound observation."""
        info = {"is_success": False, "applied_action": applied, "diverged": True}
        return self._shown(self._observation), 0.0, False, True, info

    def _is_success(self) -> bool:
        achieved, desired = self._observation["achieved_goal"], self._observation["desired_goal"]
        return bool(is_reached(achieved, desired, self.simulation.distance_threshold))

    def load(self, saved: dict[str, NDArray[np.float64]], observation: Observation, elapsed: int) -> None:
        """Take over the state of a running episode, all but the random generator.

        Args:
            saved: What ``Simulation.save`` returned.
            observation: The last observation.
            elapsed: Actions taken so far.
        """
        self.simulation.load(saved)
        self._observation, self._elapsed = observation, elapsed

    def render(self) -> Any:
        """Return a picture, uint8 [480, 480, 3], or show it under ``"human"``; the simulation is not touched."""
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
        """Leave out the window: a copy opens its own when it is first drawn."""
        return {**self.__dict__, "_picture": None}


class FlatFetch(FetchEnv):
    """
    ## Description

    A seven-jointed Fetch arm above a table, moved by displacements of its gripper, simulated by MuJoCo in steps of
    2 ms. The tasks and their models are Gymnasium-Robotics' `Fetch*-v4`, made sparse as the paper's appendix G.1
    says: 1 for reaching the goal, and the episode is over.

    - Reach: bring the gripper to a point in the air.
    - Push: push a box to a point on the table, with closed fingers.
    - Slide: hit a puck so that it slides to, and stops at, a point out of reach, with closed fingers.
    - PickAndPlace: bring a box to a point on the table or in the air.

    ## Action Space

    `Box(-1, 1, (4,), float32)`: displacement of the gripper along x, y and z, in units of 5 cm, and the opening of
    its fingers (PickAndPlace only). Values outside the box are clipped; NaN, infinity and other shapes are refused.

    ## Observation Space

    `Box(-inf, inf, (16,), float64)` for Reach, `(31,)` for the others: the observation, the achieved goal and the
    desired goal of Gymnasium-Robotics, in this order. Velocities are in metres (radians) per 40 ms, whatever
    `substep` is. With `observation="goal"`, the same three as a dictionary.

    `info` holds `is_success` (bool), after a step `applied_action` (float32, what the simulation got), and, where the
    simulation has broken down, `diverged` (True).

    ## Rewards

    1 where the achieved goal is within 5 cm of the desired one, else 0.

    ## Starting State

    The arm as it settles above the table. The object lies on the table, at least 10 cm from the gripper. Object and
    goal are drawn anew for each episode. None of it depends on `substep`.

    ## Episode End

    1. Terminated: the goal is reached (unless `terminate_on_goal=False`).
    2. Truncated: round(1000 / substep) actions were taken and the last did not terminate.
    3. Truncated: the simulation broke down; the observation is the last sound one and the reward 0.

    ## Arguments

    - `substep=20`: simulation steps for each action, 1 to 500. Fewer make the reward sparser (appendix A.4).
    - `action_noise=0.0`: standard deviation of Gaussian noise added to an action before it is clipped (appendix A.5).
    - `terminate_on_goal=True`: whether reaching the goal ends the episode.
    - `observation="flat"`: or `"goal"`, a dictionary for hindsight replay, with `compute_reward`.
    - `render_mode`: None, `"rgb_array"` or `"human"`.

    ## Version history

    - v1: the first.
    """  # noqa: D212, D415 - the sections are Gymnasium-Robotics', and so is their form

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

    def compute_reward(self, achieved_goal: Any, desired_goal: Any, info: Any) -> NDArray[np.float64]:  # noqa: ARG002 - its API
        """Return the rewards [...] of goals [..., 3], whoever achieved and desired them."""
        return is_reached(achieved_goal, desired_goal, self.simulation.distance_threshold).astype(np.float64)[()]

    def compute_terminated(self, achieved_goal: Any, desired_goal: Any, info: Any) -> Any:  # noqa: ARG002 - as above
        """Return whether reaching these goals [..., 3] would end the episode, bool [...]."""
        reached = is_reached(achieved_goal, desired_goal, self.simulation.distance_threshold)
        return (reached & self.rules.terminate_on_goal)[()]

    def compute_truncated(self, achieved_goal: Any, desired_goal: Any, info: Any) -> Any:
        """Return whether the present step is the last of the horizon and does not terminate, bool [...]."""
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
    """Make the environment of a task, of the class that its kind of observation asks for.

    Raises:
        TypeError, ValueError: An argument is unknown or not allowed.
    """
    refuse_unknown(f"Fetch{task}Sparse", unknown, ARGUMENTS, ELSEWHERE)
    check_interface(observation, render_mode)
    kind = FlatFetch if observation == "flat" else GoalFetch
    return kind(task, Rules(substep, action_noise, terminate_on_goal), render_mode)


class _EntryPoint:
    """A function that makes one task, with the metadata that Gymnasium looks for on it."""

    metadata = FetchEnv.metadata

    def __init__(self, task: str) -> None:
        self._task = task
        self.__signature__ = inspect.signature(partial(make_single, task))  # what `inspect` tells of the arguments

    def __call__(self, **arguments: Any) -> FetchEnv:
        return make_single(self._task, **arguments)


reach, push = _EntryPoint("Reach"), _EntryPoint("Push")
slide, pick_and_place = _EntryPoint("Slide"), _EntryPoint("PickAndPlace")
