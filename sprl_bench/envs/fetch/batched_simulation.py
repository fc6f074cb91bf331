"""N simulations of one Fetch task on MuJoCo's batch, bit-identical to single Gymnasium-Robotics simulations.

After an action, Gymnasium-Robotics ("upstream") closes the fingers and computes everything again in Reach, Push and
Slide. In PickAndPlace it does not: the observed positions are one substep older than the velocities, and the next
action starts from the older position. Both are reproduced here.

An observation only needs positions. So the forward pass stops before forces, without contacts and constraints; neither
changes a position.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import mujoco
import numpy as np
from gymnasium_robotics.utils.rotations import mat2euler
from numpy.typing import NDArray

from sprl_bench.envs.fetch.rules import REFERENCE_SUBSTEP
from sprl_bench.envs.fetch.simulation import DIVERGENCE, WELDED_BODY, new_simulation
from sprl_bench.envs.fetch.starts import Starts

try:
    from mujoco.batch import Batch
except ImportError as error:  # MuJoCo before 3.17
    raise ImportError(
        f"mujoco is {mujoco.__version__}; it must be at least 3.17 for the batched Fetch engine. "
        "gymnasium.make_vec(..., vectorization_mode='sync') works with older versions."
    ) from error

Floats = NDArray[np.float64]
Rows = NDArray[np.int64]

_POSITIONS: Final = int(mujoco.mjtStage.mjSTAGE_POS)
_KINEMATICS_ONLY: Final = int(mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
_COUNT: Final = 1  # index of the count among the two numbers of a warning
_ROTATION: Final = np.array([1.0, 0.0, 1.0, 0.0])  # every action adds this to the orientation of the mocap body
_DISPLACEMENT: Final = 0.05  # metres for an action of 1


class BatchedSimulation:
    """N simulations, as rows of arrays.

    Args:
        task: `"Reach"`, `"Push"`, `"Slide"` or `"PickAndPlace"`.
        substep: Simulation steps for each action.
        size: Number of simulations N.
        num_threads: Threads that share the work.

    Attributes:
        rows: The state of each simulation as MuJoCo saves it, [N, S].
        positions: Position of the welded body when it was last computed, [N, 3].
        orientations: Its orientation then, quaternions [N, 4].
        threshold: Distance within which a goal is reached, in metres.
    """

    def __init__(self, task: str, substep: int, size: int, num_threads: int) -> None:
        self._arguments = (task, substep, size, num_threads)
        reference = new_simulation(task, substep)
        reference.np_random = np.random.default_rng(0)
        reference.reset()  # all starts are equal except for the draws
        self._template = reference.save()["row"]
        self._starts = Starts.of(reference)
        self._substep = substep
        self._is_late = not reference.block_gripper
        self._seconds = REFERENCE_SUBSTEP * reference.model.opt.timestep
        self.threshold = float(reference.distance_threshold)
        self.positions = np.zeros((size, 3))
        self.orientations = np.zeros((size, 4))
        self._find(reference.model, has_object=reference.has_object)
        self._bind(Batch(reference.model, size, nthread=num_threads))

    def _find(self, model: mujoco.MjModel, *, has_object: bool) -> None:
        """Look up the indices in MuJoCo's arrays."""
        names = [model.joint(index).name for index in range(model.njnt)]
        gripper = [name for name in names if name.startswith("robot")][-2:]
        self._gripper_qpos = np.array([model.joint(name).qposadr[0] for name in gripper])
        self._gripper_qvel = np.array([model.joint(name).dofadr[0] for name in gripper])
        self._actuated = model.jnt_qposadr[model.actuator_trnid[:, 0]]
        self._welded = model.body(WELDED_BODY).id
        self._sites = [model.site(name).id for name in ("robot0:grip", "object0")[: 1 + has_object]]
        self._site_bodies = [int(model.site_bodyid[site]) for site in self._sites]
        self._object_qpos = model.joint("object0:joint").qposadr[0] if has_object else 0

    def _bind(self, batch: Batch) -> None:
        self._batch = batch
        self.rows: Floats = batch.state
        self._qpos, self._qvel, self._ctrl = batch.bind("qpos"), batch.bind("qvel"), batch.bind("ctrl")
        self._mocap_pos, self._mocap_quat = batch.bind("mocap_pos")[:, 0], batch.bind("mocap_quat")[:, 0]
        self._xpos, self._xquat = batch.bind("xpos"), batch.bind("xquat")
        self._site_xpos, self._site_xmat = batch.bind("site_xpos"), batch.bind("site_xmat")
        self._disabled = batch.expand("opt.disableflags")
        self._enabled = self._disabled.copy()

    def start(self, rows: Rows, generators: Sequence[np.random.Generator]) -> Floats:
        """Start an episode in the simulations `rows`; return their observations with goals, [n, D]."""
        places, goals = zip(*(self._starts.draw(generators[row]) for row in rows.tolist()), strict=True)
        self.rows[rows] = self._template
        self._qpos[rows, self._object_qpos : self._object_qpos + len(places[0])] = places
        self._compute_positions(rows)
        self._remember_welded(rows)
        return self._observations(rows, self._velocities(rows), np.stack(goals))

    def advance(self, rows: Rows, actions: NDArray[np.float32], goals: Floats) -> tuple[Floats, NDArray[np.bool_]]:
        """Apply actions [n, 4] to the simulations `rows`.

        Returns:
            Their observations [n, D], and which have diverged, bool [n]; the observations of these are meaningless.
        """
        self._batch.warning[rows] = 0
        self._act(rows, actions)
        with np.errstate(all="ignore"):  # some may diverge
            velocities = self._step_late(rows) if self._is_late else self._step(rows)
            observations = self._observations(rows, velocities, goals)
        self._remember_welded(rows)
        return observations, self._batch.warning[rows[:, None], DIVERGENCE, _COUNT].any(axis=1)

    def _act(self, rows: Rows, actions: NDArray[np.float32]) -> None:
        opening = actions[:, 3:].astype(np.float64) if self._is_late else 0.0
        self._ctrl[rows] = self._qpos[rows[:, None], self._actuated] + opening
        self._mocap_pos[rows] = self.positions[rows] + actions[:, :3] * np.float32(_DISPLACEMENT)
        self._mocap_quat[rows] = self.orientations[rows] + _ROTATION

    def _step(self, rows: Rows) -> list[Floats]:
        """Step, close the fingers, and compute everything again."""
        self._batch.step(rows, nstep=self._substep)
        self._qpos[rows[:, None], self._gripper_qpos] = 0.0
        self._compute_positions(rows)
        return self._velocities(rows)

    def _step_late(self, rows: Rows) -> list[Floats]:
        """Step; positions are those before the last substep, velocities those after it."""
        if self._substep > 1:
            self._batch.step(rows, nstep=self._substep - 1)
        self._compute_positions(rows)
        jacobians = self._jacobians(rows)
        self._batch.step(rows, nstep=1)
        return self._times_qvel(rows, jacobians)

    def _compute_positions(self, rows: Rows) -> None:
        self._disabled[rows] |= _KINEMATICS_ONLY
        self._batch.forward(rows, stage=_POSITIONS)
        self._disabled[rows] = self._enabled[rows]

    def _remember_welded(self, rows: Rows) -> None:
        self.positions[rows] = self._xpos[rows, self._welded]
        self.orientations[rows] = self._xquat[rows, self._welded]

    def _velocities(self, rows: Rows) -> list[Floats]:
        return self._times_qvel(rows, self._jacobians(rows))

    def _jacobians(self, rows: Rows) -> list[Floats]:
        """Return the Jacobians [n, 3, V] of the gripper's velocity and of the object's linear and angular velocity."""
        grip, *objects = (
            self._batch.jac(body, self._site_xpos[rows, site], rows)
            for body, site in zip(self._site_bodies, self._sites, strict=True)
        )
        return [grip[0], *(jacobian for pair in objects for jacobian in pair)]

    def _times_qvel(self, rows: Rows, jacobians: list[Floats]) -> list[Floats]:
        """Return velocities [n, 3], per action of 20 substeps (40 ms)."""
        qvel = self._qvel[rows][:, :, None]
        return [(jacobian @ qvel)[:, :, 0] * self._seconds for jacobian in jacobians]

    def _observations(self, rows: Rows, velocities: list[Floats], goals: Floats) -> Floats:
        """Return observation, achieved goal and desired goal, [n, D]."""
        grip_velocity, *object_velocities = velocities
        grip, *objects = (self._site_xpos[rows, site] for site in self._sites)
        fingers = self._qpos[rows[:, None], self._gripper_qpos]
        finger_velocities = self._qvel[rows[:, None], self._gripper_qvel] * self._seconds
        if not objects:
            return np.concatenate([grip, fingers, grip_velocity, finger_velocities, grip, goals], axis=1)
        (thing,), (linear, angular) = objects, object_velocities
        rotation = mat2euler(self._site_xmat[rows, self._sites[1]].reshape(-1, 3, 3))
        parts = [grip, thing, thing - grip, fingers, rotation, linear - grip_velocity, angular, grip_velocity]
        return np.concatenate([*parts, finger_velocities, thing, goals], axis=1)

    def __getstate__(self) -> dict[str, Any]:
        arrays = {name: getattr(self, name).copy() for name in ("rows", "positions", "orientations")}
        return {"arguments": self._arguments, "arrays": arrays}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__init__(*state["arguments"])  # type: ignore[misc]  # a batch cannot be copied, so this makes a new one
        for name, values in state["arrays"].items():
            getattr(self, name)[...] = values
