"""The batched Fetch engine: bit-identical to the single environments, on MuJoCo's batch."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.utils.seeding import np_random
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from sprl_bench.envs.checks import refuse_unknown_of_engine
from sprl_bench.envs.engine import Array, Mask, Rows
from sprl_bench.envs.fetch import rules
from sprl_bench.envs.fetch.batched_simulation import BatchedSimulation
from sprl_bench.envs.fetch.fetch_env import FetchEnv, is_reached, make_single
from sprl_bench.envs.fetch.rules import ACTION_SPACE, ELSEWHERE, Rules, checked_actions
from sprl_bench.envs.streams import from_generator, from_generators, to_generator, to_generators
from sprl_bench.envs.vector import BatchedEnv

_WIDTHS: Final = {"Reach": (10, 3, 3), "Push": (25, 3, 3), "Slide": (25, 3, 3), "PickAndPlace": (25, 3, 3)}
_NAMES: Final = ("observation", "achieved_goal", "desired_goal")
_ACHIEVED, _DESIRED = slice(-6, -3), slice(-3, None)


class FetchEngine(BatchedEnv):
    """N Fetch simulations with flat observations.

    Args:
        task: `"Reach"`, `"Push"`, `"Slide"` or `"PickAndPlace"`.
        rules: The arguments that change the decision process.
        num_envs: Number of sub-environments N.
        arguments: The arguments of `BatchedEnv`.
    """

    observation = "flat"

    def __init__(self, task: str, rules: Rules, num_envs: int = 1, **arguments: Any) -> None:
        self.metadata = rules.metadata
        self.task, self.rules = task, rules
        super().__init__(
            num_envs,
            single_observation_space=spaces.Box(-np.inf, np.inf, (sum(_WIDTHS[task]),), np.float64),
            single_action_space=spaces.Box(ACTION_SPACE.low, ACTION_SPACE.high, dtype=np.float32),
            **arguments,
        )
        self._simulation = BatchedSimulation(task, rules.substep, self.num_envs, self._threads.count)
        self._generators = [np.random.default_rng(0)] * self.num_envs  # until they are seeded
        self._is_success = np.zeros(self.num_envs, np.bool_)
        self._diverged = np.zeros(self.num_envs, np.bool_)
        self._stepped = np.zeros(self.num_envs, np.bool_)  # whether the last call was a step, not a restart
        self._applied = np.zeros((self.num_envs, 4), np.float32)

    def _seed(self, rows: Rows, seeds: list[int]) -> None:
        for row, seed in zip(rows.tolist(), seeds, strict=True):
            self._generators[row], _ = np_random(seed)

    def _restart(self, rows: Rows) -> None:
        self._observations[rows] = self._simulation.start(rows, self._generators)
        self._is_success[rows] = self._are_reached(rows)
        self._stepped[rows] = self._diverged[rows] = False

    def _advance(self, actions: NDArray[np.float32]) -> None:
        rows = np.flatnonzero(~self._ended)
        self._rewards[:], self._terminations[:], self._truncations[:] = 0.0, False, False
        self._diverged[:] = False
        if not len(rows):
            return
        self._applied[rows] = applied = self.rules.applied(actions[rows], [self._generators[row] for row in rows])
        observations, diverged = self._simulation.advance(rows, applied, self._observations[rows, _DESIRED])
        self._observations[rows[~diverged]] = observations[~diverged]
        success = self._are_reached(rows) & ~diverged
        self._stepped[rows], self._diverged[rows], self._is_success[rows] = True, diverged, success
        self._rewards[rows] = success
        self._terminations[rows] = success & self.rules.terminate_on_goal
        self._truncations[rows] = diverged | ((self._elapsed[rows] >= self.rules.horizon) & ~self._terminations[rows])

    def _are_reached(self, rows: Rows) -> Mask:
        observations = self._observations[rows]
        return is_reached(observations[:, _ACHIEVED], observations[:, _DESIRED], self._simulation.threshold)

    def _checked_actions(self, actions: Any) -> NDArray[np.float32]:
        return checked_actions(actions, (self.num_envs, 4), ~self._ended)

    def _information(self) -> Mapping[str, Array]:
        return {"is_success": self._is_success, "applied_action": self._applied, "diverged": self._diverged}

    def _infos(self, mask: Mask, rows: Rows | None = None) -> dict[str, Any]:  # noqa: ARG002 - the mask is enough
        """Return the information of the masked sub-environments; an entry that none of them has is left out."""
        has = {"is_success": mask, "applied_action": mask & self._stepped, "diverged": mask & self._diverged}
        infos: dict[str, Any] = {}
        for name, values in self._information().items():
            if has[name].any():
                infos[name] = np.zeros_like(values)
                infos[name][has[name]] = values[has[name]]
                infos[f"_{name}"] = has[name].copy()
        return infos

    def _all_infos(self) -> dict[str, Any]:
        return self._infos(np.ones(self.num_envs, np.bool_))

    def _kind(self) -> str:
        return f"{self.task} {self.rules} {self.observation}"

    def _arrays(self) -> Mapping[str, Array]:
        return {
            "observations": self._observations,
            "simulations": self._simulation.rows,
            "positions": self._simulation.positions,
            "orientations": self._simulation.orientations,
            "streams": from_generators(self._generators),
        }

    def set_state(self, state: Mapping[str, Array]) -> None:
        """Restore a state from `get_state` of an engine with the same id, arguments and N.

        Raises:
            ValueError: The state is not from such an engine. No state has changed.
        """
        super().set_state(state)
        self._generators = to_generators(state["streams"])

    def _check_state(self, state: Mapping[str, Array]) -> None:
        for name in ("observations", "simulations", "positions", "orientations"):
            if not np.isfinite(state[name]).all():
                raise ValueError(f"state[{name!r}] is not finite; it must be finite numbers.")

    def _generator(self, row: int) -> np.random.Generator:
        return to_generator(from_generator(self._generators[row]))

    def _single(self) -> gymnasium.Env[Any, Any]:
        return make_single(
            self.task,
            substep=self.rules.substep,
            action_noise=self.rules.action_noise,
            terminate_on_goal=self.rules.terminate_on_goal,
            observation=self.observation,
            render_mode=self.render_mode,
        )

    def _load(self, single: gymnasium.Env[Any, Any], row: int) -> None:
        assert isinstance(single, FetchEnv)
        observation = _split(self._observations[row], self.task)
        saved = {
            "row": self._simulation.rows[row].copy(),
            "position": self._simulation.positions[row],
            "orientation": self._simulation.orientations[row],
            "goal": observation["desired_goal"],
        }
        single.load(saved, observation, int(self._elapsed[row]))


class GoalFetchEngine(FetchEngine):
    """The same simulations, with dictionaries of observation, achieved and desired goal as observations."""

    observation = "goal"

    def __init__(self, task: str, rules: Rules, num_envs: int = 1, **arguments: Any) -> None:
        super().__init__(task, rules, num_envs, **arguments)
        self.single_observation_space: spaces.Dict = spaces.Dict(
            {
                name: spaces.Box(-np.inf, np.inf, (width,), np.float64)
                for name, width in zip(_NAMES, _WIDTHS[task], strict=True)
            }
        )
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)

    def compute_reward(self, achieved_goal: Any, desired_goal: Any, info: Any) -> NDArray[np.float64]:  # noqa: ARG002 - GoalEnv's API
        """Return the rewards [...] of any achieved and desired goals [..., 3], as each sub-environment would."""
        return is_reached(achieved_goal, desired_goal, self._simulation.threshold).astype(np.float64)[()]

    def _current_observations(self) -> Any:
        return _split(super()._current_observations(), self.task)

    def _same_step(self, ended: Mask) -> dict[str, Any]:
        finals = super()._same_step(ended)
        for row in np.flatnonzero(ended):
            finals["final_obs"][row] = _split(finals["final_obs"][row], self.task)
        return finals


def _split(observations: NDArray[np.float64], task: str) -> dict[str, NDArray[np.float64]]:
    """Return copies of the three parts [..., width] of flat observations [..., D]."""
    parts = np.split(observations, np.cumsum(_WIDTHS[task])[:-1], axis=-1)
    return {name: part.copy() for name, part in zip(_NAMES, parts, strict=True)}


def make_engine(
    task: str,
    num_envs: int = 1,
    *,
    substep: int = Rules.substep,
    action_noise: float = Rules.action_noise,
    terminate_on_goal: bool = Rules.terminate_on_goal,
    observation: str = "flat",
    render_mode: str | None = None,
    **arguments: Any,
) -> FetchEngine:
    """Make the engine of a task, with the class for its kind of observation.

    Raises:
        TypeError, ValueError: An argument is unknown or not allowed.
    """
    refuse_unknown_of_engine(f"Fetch{task}Sparse", arguments, rules.ARGUMENTS, ELSEWHERE)
    rules.check_interface(observation, render_mode)
    kind = FetchEngine if observation == "flat" else GoalFetchEngine
    chosen = Rules(substep, action_noise, terminate_on_goal)
    return kind(task, chosen, num_envs, render_mode=render_mode, **arguments)


class _EntryPoint:
    """A callable that makes the engine of one task."""

    metadata: Final = {**FetchEnv.metadata, "autoreset_mode": AutoresetMode.SAME_STEP}

    def __init__(self, task: str) -> None:
        self._task = task

    def __call__(self, num_envs: int = 1, **arguments: Any) -> FetchEngine:
        return make_engine(self._task, num_envs, **arguments)


reach, push = _EntryPoint("Reach"), _EntryPoint("Push")
slide, pick_and_place = _EntryPoint("Slide"), _EntryPoint("PickAndPlace")
