"""The simulation of one Fetch task: Gymnasium-Robotics' ("upstream"), with a choice of the substeps for each action.

The constructor is upstream's: the arm settles for 10 x 20 substeps, goals are sampled around its position then, and
velocities are scaled by 20 substeps. `substep` only changes the steps between two observations, not the start state,
the goals or the scale of an observation.
"""

from __future__ import annotations

from typing import Any, Final

import mujoco
import numpy as np
from gymnasium_robotics.envs.fetch.pick_and_place import MujocoFetchPickAndPlaceEnv
from gymnasium_robotics.envs.fetch.push import MujocoFetchPushEnv
from gymnasium_robotics.envs.fetch.reach import MujocoFetchReachEnv
from gymnasium_robotics.envs.fetch.slide import MujocoFetchSlideEnv
from numpy.typing import NDArray

from sprl_bench.envs.fetch.rules import REFERENCE_SUBSTEP
from sprl_bench.envs.fetch.upstream import joint_utils

Observation = dict[str, NDArray[np.float64]]
Row = NDArray[np.float64]

STATE: Final = mujoco.mjtState.mjSTATE_INTEGRATION
"""The saved part of the state: everything that a next step depends on, except derived fields that it reads."""

WELDED_BODY: Final = "robot0:gripper_link"
"""The body welded to the mocap body. An action is relative to its last computed position."""

DIVERGENCE: Final = [
    int(mujoco.mjtWarning.mjWARN_BADQPOS),
    int(mujoco.mjtWarning.mjWARN_BADQVEL),
    int(mujoco.mjtWarning.mjWARN_BADQACC),
]


class Simulation:
    """Our part of the simulation of every task, mixed into upstream's classes.

    Attributes:
        substep: Simulation steps for each action.
    """

    substep: int = REFERENCE_SUBSTEP
    model: mujoco.MjModel
    data: mujoco.MjData
    goal: NDArray[np.float64]

    def _initialize_simulation(self) -> None:
        self._utils = joint_utils()
        super()._initialize_simulation()  # type: ignore[misc]  # upstream's

    def _mujoco_step(self, action: Any) -> None:  # noqa: ARG002 - upstream's hook
        mujoco.mj_step(self.model, self.data, nstep=self.substep)

    @property
    def dt(self) -> float:
        """Simulated seconds between two observations."""
        return float(self.model.opt.timestep * self.substep)

    @property
    def has_diverged(self) -> bool:
        """Whether a step since the last reset had a non-finite or huge number, after which MuJoCo resets itself."""
        return bool(self.data.warning.number[DIVERGENCE].any())

    def save(self) -> dict[str, Row]:
        """Return a state from which `load` continues exactly.

        It includes the last computed pose of the welded body, which in PickAndPlace is one substep old.
        """
        row = np.empty(mujoco.mj_stateSize(self.model, STATE))
        mujoco.mj_getState(self.model, self.data, row, STATE)
        body = self.data.body(WELDED_BODY)
        return {"row": row, "position": body.xpos.copy(), "orientation": body.xquat.copy(), "goal": self.goal.copy()}

    def load(self, saved: dict[str, Row]) -> None:
        """Restore a state from `save`."""
        mujoco.mj_resetData(self.model, self.data)
        mujoco.mj_setState(self.model, self.data, saved["row"], STATE)
        mujoco.mj_forward(self.model, self.data)
        body = self.data.body(WELDED_BODY)
        body.xpos[:], body.xquat[:] = saved["position"], saved["orientation"]
        self.goal = saved["goal"].copy()

    def __getstate__(self) -> dict[str, Any]:
        return {"substep": self.substep, "saved": self.save()}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__init__()  # type: ignore[misc]  # as upstream's own unpickling does
        self.substep = state["substep"]
        self.load(state["saved"])


class _Reach(Simulation, MujocoFetchReachEnv):  # type: ignore[misc]  # upstream is untyped
    pass


class _Push(Simulation, MujocoFetchPushEnv):  # type: ignore[misc] # upstream has no types
    pass


class _Slide(Simulation, MujocoFetchSlideEnv):  # type: ignore[misc] # upstream has no types
    pass


class _PickAndPlace(Simulation, MujocoFetchPickAndPlaceEnv):  # type: ignore[misc] # upstream has no types
    pass


_CLASSES: Final = {"Reach": _Reach, "Push": _Push, "Slide": _Slide, "PickAndPlace": _PickAndPlace}


def new_simulation(task: str, substep: int) -> Any:
    """Return the settled simulation of a task: `"Reach"`, `"Push"`, `"Slide"` or `"PickAndPlace"`."""
    simulation = _CLASSES[task]()
    simulation.substep = substep
    return simulation
