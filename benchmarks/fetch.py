"""The batched Fetch engine against EnvPool, against MuJoCo's batch alone, and against Gymnasium-Robotics.

Everyone takes uniformly random actions through whole episodes, resets included. EnvPool's and Gymnasium-Robotics'
episodes do not end at the goal, so ours do not either, here.
"""

from __future__ import annotations

from functools import partial
from typing import Any

import gymnasium
import mujoco
import numpy as np
from gymnasium.vector import AsyncVectorEnv
from gymnasium.wrappers import TimeLimit
from mujoco.batch import Batch

import sprl_bench  # noqa: F401 - registers the ids
from benchmarks.contenders import contender, optional
from benchmarks.measure import Row, compare
from benchmarks.turns import Turn
from sprl_bench.envs.fetch.simulation import WELDED_BODY, new_simulation

NUM_ENVS, NUM_THREADS = 64, 2
TASKS = ("Reach", "Push")
ENVPOOL_BARS = {3: 1.5, 20: 1.2}
RAW_BAR, ASYNCHRONOUS_BAR = 0.85, 5.0
ASYNCHRONOUS_SUBSTEP = 3
REPEATS = 5


def rows() -> list[Row]:
    """Measure all rows; takes about five minutes on an idle machine with two cores."""
    cases = [(task, substep) for task in TASKS for substep in ENVPOOL_BARS]
    return [
        *(_against_envpool(task, substep) for task, substep in cases),
        *(_against_raw(task, substep) for task, substep in cases),
        *(_against_asynchronous(task) for task in TASKS),
    ]


def _against_envpool(task: str, substep: int) -> Row:
    return compare(
        _what(task, substep),
        contender(ours, task=task, substep=substep),
        f"EnvPool Fetch{task}-v4, frame_skip {substep}",
        optional("envpool", "envpool", pool, task=task, substep=substep),
        bar=ENVPOOL_BARS[substep],
        repeats=REPEATS,
    )


def _against_raw(task: str, substep: int) -> Row:
    return compare(
        _what(task, substep),
        contender(ours, task=task, substep=substep),
        "mujoco.batch: step, positions and Jacobians alone",
        contender(raw, task=task, substep=substep),
        bar=RAW_BAR,
        repeats=REPEATS,
    )


def _against_asynchronous(task: str) -> Row:
    return compare(
        _what(task, ASYNCHRONOUS_SUBSTEP),
        contender(ours, task=task, substep=ASYNCHRONOUS_SUBSTEP),
        "gymnasium-robotics, AsyncVectorEnv, 2 workers",
        contender(asynchronous, task=task, substep=ASYNCHRONOUS_SUBSTEP),
        bar=ASYNCHRONOUS_BAR,
        repeats=REPEATS,
    )


def _what(task: str, substep: int) -> str:
    return f"Fetch{task}, substep {substep}, N={NUM_ENVS}, {NUM_THREADS} threads"


def episode_steps(substep: int) -> int:
    """Return the steps of an episode."""
    return round(1000 / substep)


def ours(task: str, substep: int) -> Turn:
    """Return turns of our engine."""
    envs = gymnasium.make_vec(
        f"SPRL/Fetch{task}Sparse-v1", NUM_ENVS, num_threads=NUM_THREADS, substep=substep, terminate_on_goal=False
    )
    return _stepper(envs, NUM_ENVS, episode_steps(substep))


def pool(task: str, substep: int) -> Turn:
    """Return turns of EnvPool."""
    import envpool  # noqa: PLC0415 - optional

    steps = episode_steps(substep)
    envs = envpool.make_gymnasium(
        f"Fetch{task}-v4", num_envs=NUM_ENVS, num_threads=NUM_THREADS, frame_skip=substep, max_episode_steps=steps
    )
    return _stepper(envs, NUM_ENVS, steps)


def raw(task: str, substep: int) -> Turn:
    """Return turns of the least that MuJoCo must do."""
    return RawPhysics(task, substep, num_envs=NUM_ENVS, num_threads=NUM_THREADS, steps=episode_steps(substep))


def asynchronous(task: str, substep: int) -> Turn:
    """Return turns of Gymnasium-Robotics' own step in two processes; mended, as it does not run on this MuJoCo."""
    steps = episode_steps(substep)
    envs = AsyncVectorEnv([lambda: TimeLimit(new_simulation(task, substep), steps)] * 2, context="spawn")
    return _stepper(envs, 2, steps)


class RawPhysics:
    """Steps a batch from starts of the task: step, close the fingers, positions, Jacobians; no resets, nothing of ours.

    Args:
        task: Its name in Gymnasium-Robotics.
        substep: Simulation steps for each action.
        num_envs: Simulations in the batch.
        num_threads: MuJoCo's.
        steps: Actions in a turn.
    """

    def __init__(self, task: str, substep: int, *, num_envs: int, num_threads: int, steps: int) -> None:
        simulation = new_simulation(task, substep)
        simulation.np_random = np.random.default_rng(0)
        starts = [simulation.reset() and simulation.save()["row"] for _ in range(num_envs)]
        model = simulation.model
        self._starts, self._substep = np.stack(starts), substep
        self._batch = Batch(model, num_envs, nthread=num_threads)
        self._welded = model.body(WELDED_BODY).id
        self._fingers = [int(model.joint(f"robot0:{side}_gripper_finger_joint").qposadr[0]) for side in "lr"]
        self._actuated = model.jnt_qposadr[model.actuator_trnid[:, 0]]  # none in Reach
        self._sites = [model.site(name) for name in ("robot0:grip", "object0")[: 1 + simulation.has_object]]
        self._disabled = self._batch.expand("opt.disableflags")
        for field in ("xpos", "xquat", "site_xpos", "site_xmat"):
            self._batch.bind(field)
        self._displacements = np.random.default_rng(0).uniform(-0.05, 0.05, (steps, num_envs, 3))

    def __call__(self) -> int:
        """Take a turn."""
        self._batch.state[:] = self._starts
        self._batch.forward()
        for displacement in self._displacements:
            self._batch.mocap_pos[:, 0] = self._batch.xpos[:, self._welded] + displacement
            self._batch.mocap_quat[:, 0] = self._batch.xquat[:, self._welded] + (1.0, 0.0, 1.0, 0.0)
            self._batch.ctrl[:] = self._batch.qpos[:, self._actuated]
            self._batch.step(nstep=self._substep)
            self._batch.qpos[:, self._fingers] = 0.0
            self._observe()
        return len(self._displacements) * len(self._starts)

    def _observe(self) -> None:
        self._disabled[:] = mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
        self._batch.forward(stage=mujoco.mjtStage.mjSTAGE_POS)
        self._disabled[:] = 0
        for site in self._sites:
            self._batch.jac(int(site.bodyid[0]), self._batch.site_xpos[:, site.id])


def _stepper(envs: Any, num_envs: int, steps: int) -> Turn:
    """Return turns of `steps` vector steps with actions drawn beforehand."""
    actions = list(np.random.default_rng(0).uniform(-1, 1, (steps, num_envs, 4)).astype(np.float32))
    envs.reset()
    return partial(_run, envs, actions)


def _run(envs: Any, actions: list[np.ndarray[Any, Any]]) -> int:
    for action in actions:
        envs.step(action)
    return sum(map(len, actions))
