"""The arguments of a Fetch task, checked, and the settings that follow from them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from gymnasium.spaces import Box
from numpy.typing import NDArray

from sprl_bench.envs.checks import check_choice, check_integer

Actions = NDArray[np.float32]

REFERENCE_SUBSTEP: Final = 20
"""The substeps of the original tasks; the arm settles and velocities are scaled with it."""

ARGUMENTS: Final = ("substep", "action_noise", "terminate_on_goal", "observation", "render_mode")

ELSEWHERE: Final = {
    **dict.fromkeys(("n_substeps", "num_substeps", "frame_skip", "frameskip", "action_repeat"), "substep"),
    **dict.fromkeys(("noise", "noise_std", "action_noise_std", "sigma"), "action_noise"),
    **dict.fromkeys(("terminate_on_success", "terminate"), "terminate_on_goal"),
}
"""Other projects' names for the arguments of these tasks."""

_OBSERVATIONS: Final = ("flat", "goal")
_RENDER_MODES: Final = ("human", "rgb_array")

ACTION_SPACE: Final = Box(-1.0, 1.0, (4,), np.float32)

_TIMESTEP: Final = 0.002  # seconds of a simulation step, in the models of all four tasks
_SIMULATION_STEPS: Final = 1000  # of an episode: appendix A.4 keeps episode length x substep constant


@dataclass(frozen=True)
class Rules:
    """The arguments that change the decision process.

    Attributes:
        substep: Simulation steps for each action.
        action_noise: Standard deviation of the Gaussian noise added to an action before it is clipped.
        terminate_on_goal: Whether reaching the goal ends the episode.

    Raises:
        TypeError, ValueError: A value is not allowed.
    """

    substep: int = REFERENCE_SUBSTEP
    action_noise: float = 0.0
    terminate_on_goal: bool = True

    def __post_init__(self) -> None:
        object.__setattr__(self, "substep", check_integer("substep", self.substep, 1, 500))
        object.__setattr__(self, "action_noise", _checked_noise(self.action_noise))
        if not isinstance(self.terminate_on_goal, bool | np.bool_):
            raise TypeError(f"terminate_on_goal is {self.terminate_on_goal!r}; it must be True or False.")
        object.__setattr__(self, "terminate_on_goal", bool(self.terminate_on_goal))

    @property
    def horizon(self) -> int:
        """Actions in a full episode: 1000 / substep, rounded like Python's `round` (62.5 to the even 62)."""
        return round(_SIMULATION_STEPS / self.substep)

    @property
    def metadata(self) -> dict[str, Any]:
        """Render modes, actions per simulated second, and the duration of an action.

        `action_time` is the duration of an action divided by that of a reference action of 20 simulation steps.
        """
        return {
            "render_modes": list(_RENDER_MODES),
            "render_fps": round(1 / (self.substep * _TIMESTEP)),
            "action_time": self.substep / REFERENCE_SUBSTEP,
        }

    def applied(self, actions: Actions, generators: list[np.random.Generator]) -> Actions:
        """Return the applied actions [N, 4]: with noise from each generator, then clipped.

        Without noise, nothing is drawn from the generators.
        """
        if self.action_noise == 0.0:
            return np.clip(actions, -1.0, 1.0)
        noise = np.stack([generator.standard_normal(4) for generator in generators]) * self.action_noise
        return np.clip(actions + noise, -1.0, 1.0).astype(np.float32)


def checked_actions(actions: Any, shape: tuple[int, ...], used: NDArray[np.bool_] | bool = True) -> Actions:
    """Return actions as float32 of this shape. Rows that are not `used`, bool [N], are not checked for finite values.

    Raises:
        TypeError: The actions are not real numbers.
        ValueError: The shape is wrong, or a number is NaN or infinite (as float32).
    """
    given = np.asarray(actions)
    if given.dtype.kind not in "fiub":
        raise TypeError(f"action is {actions!r}; it must be an array of real numbers.")
    if given.shape != shape:
        raise ValueError(f"action has shape {given.shape}; it must be of shape {shape}.")
    with np.errstate(over="ignore"):  # a float64 too large for float32 becomes infinite
        cast = given.astype(np.float32)
    if not np.isfinite(cast[used]).all():
        raise ValueError(f"action is {given.tolist()}; it must be finite.")
    return cast


def check_interface(observation: object, render_mode: object) -> None:
    """Check the kind of observation and the render mode.

    Raises:
        ValueError: One of them is unknown.
    """
    check_choice("observation", observation, _OBSERVATIONS)
    check_choice("render_mode", render_mode, [None, *_RENDER_MODES])


def _checked_noise(value: Any) -> float:
    allowed = "a finite number of at least 0"
    if isinstance(value, bool) or not isinstance(value, int | float | np.integer | np.floating):
        raise TypeError(f"action_noise is {value!r}; it must be {allowed}.")
    if not (math.isfinite(value) and value >= 0):
        raise ValueError(f"action_noise is {value!r}; it must be {allowed}.")
    return float(value)
