"""The batched Fetch engine against EnvPool, against MuJoCo's batch alone, and against Gymnasium-Robotics.

Everyone takes uniformly random actions through whole episodes, resets included. EnvPool's and Gymnasium-Robotics'
episodes do not end at the goal, so ours do not either, here.
"""

from __future__ import annotations

import importlib.util
from functools import partial
from typing import Any

import gymnasium
import mujoco
import numpy as np
from gymnasium.vector import AsyncVectorEnv
from gymnasium.wrappers import TimeLimit
from mujoco.batch import Batch

import sprl_bench  # noqa: F401 - registers the ids
from benchmarks.measure import Contender, Row, compare, missing, table
from sprl_bench.envs.fetch.simulation import WELDED_BODY, new_simulation

NUM_ENVS, NUM_THREADS = 64, 2
TASKS = ("Reach", "Push")
ENVPOOL_BARS = {3: 1.5, 20: 1.2}
RAW_BAR, ASYNCHRONOUS_BAR = 0.85, 5.0


def rows(repeats: int = 5) -> list[Row]:
    """Measure all rows; takes about five minutes on an idle machine with two cores."""
    cases = [(task, substep) for task in TASKS for substep in ENVPOOL_BARS]
    return [
        *(_against_envpool(task, substep, repeats) for task, substep in cases),
        *(_against_raw(task, substep, repeats) for task, substep in cases),
        *(_against_asynchronous(task, repeats) for task in TASKS),
    ]


def main() -> None:
    """Print the table."""
    print(table(rows()))


def _what(task: str, substep: int) -> str:
    return f"Fetch{task}, substep {substep}, N={NUM_ENVS}, {NUM_THREADS} threads"


def _ours(task: str, substep: int) -> Contender:
    envs = gymnasium.make_vec(
        f"SPRL/Fetch{task}Sparse-v1", NUM_ENVS, num_threads=NUM_THREADS, substep=substep, terminate_on_goal=False
    )
    return _stepper(envs, NUM_ENVS, steps=round(1000 / substep))


def _against_envpool(task: str, substep: int, repeats: int) -> Row:
    against, bar = f"EnvPool Fetch{task}-v4, frame_skip {substep}", ENVPOOL_BARS[substep]
    if importlib.util.find_spec("envpool") is None:
        return missing(_what(task, substep), against, bar=bar)
    import envpool  # noqa: PLC0415 - optional

    steps = round(1000 / substep)
    theirs = envpool.make_gymnasium(
        f"Fetch{task}-v4",
        num_envs=NUM_ENVS,
        num_threads=NUM_THREADS,
        frame_skip=substep,
        max_episode_steps=steps,
    )
    pool = _stepper(theirs, NUM_ENVS, steps=steps)
    return compare(_what(task, substep), _ours(task, substep), against, pool, bar=bar, repeats=repeats)


def _against_raw(task: str, substep: int, repeats: int) -> Row:
    """Compare with the least that MuJoCo must do: step, fingers closed, positions, Jacobians; no resets."""
    raw = _Raw(task, substep)
    against = "mujoco.batch: step, positions and Jacobians alone"
    return compare(_what(task, substep), _ours(task, substep), against, raw, bar=RAW_BAR, repeats=repeats)


def _against_asynchronous(task: str, repeats: int) -> Row:
    """Compare with Gymnasium-Robotics' own step in two processes; mended, as it does not run on this MuJoCo."""
    substep = 3
    steps = round(1000 / substep)

    def make() -> gymnasium.Env[Any, Any]:
        return TimeLimit(new_simulation(task, substep), steps)

    theirs = AsyncVectorEnv([make] * 2, context="spawn")
    against = "gymnasium-robotics, AsyncVectorEnv, 2 workers"
    row = compare(
        _what(task, substep),
        _ours(task, substep),
        against,
        _stepper(theirs, 2, steps=steps),
        bar=ASYNCHRONOUS_BAR,
        repeats=repeats,
    )
    theirs.close()
    return row


class _Raw:
    """Steps a batch from starts of the task, with nothing of ours around it."""

    def __init__(self, task: str, substep: int) -> None:
        simulation = new_simulation(task, substep)
        simulation.np_random = np.random.default_rng(0)
        starts = [simulation.reset() and simulation.save()["row"] for _ in range(NUM_ENVS)]
        model = simulation.model
        self._starts, self._substep = np.stack(starts), substep
        self._batch = Batch(model, NUM_ENVS, nthread=NUM_THREADS)
        self._welded = model.body(WELDED_BODY).id
        self._fingers = [int(model.joint(f"robot0:{side}_gripper_finger_joint").qposadr[0]) for side in "lr"]
        self._actuated = model.jnt_qposadr[model.actuator_trnid[:, 0]]  # none in Reach
        self._sites = [model.site(name) for name in ("robot0:grip", "object0")[: 1 + simulation.has_object]]
        self._disabled = self._batch.expand("opt.disableflags")
        for field in ("xpos", "xquat", "site_xpos", "site_xmat"):
            self._batch.bind(field)
        shape = (round(1000 / substep), NUM_ENVS, 3)
        self._displacements = np.random.default_rng(0).uniform(-0.05, 0.05, shape)

    def __call__(self) -> int:
        self._batch.state[:] = self._starts
        self._batch.forward()
        for displacement in self._displacements:
            self._batch.mocap_pos[:, 0] = self._batch.xpos[:, self._welded] + displacement
            self._batch.mocap_quat[:, 0] = self._batch.xquat[:, self._welded] + (1.0, 0.0, 1.0, 0.0)
            self._batch.ctrl[:] = self._batch.qpos[:, self._actuated]
            self._batch.step(nstep=self._substep)
            self._batch.qpos[:, self._fingers] = 0.0
            self._observe()
        return len(self._displacements) * NUM_ENVS

    def _observe(self) -> None:
        self._disabled[:] = mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
        self._batch.forward(stage=mujoco.mjtStage.mjSTAGE_POS)
        self._disabled[:] = 0
        for site in self._sites:
            self._batch.jac(int(site.bodyid[0]), self._batch.site_xpos[:, site.id])


def _stepper(envs: Any, num_envs: int, steps: int) -> Contender:
    """Return work of ``steps`` vector steps with actions drawn beforehand."""
    actions = list(np.random.default_rng(0).uniform(-1, 1, (steps, num_envs, 4)).astype(np.float32))
    envs.reset()
    return partial(_run, envs, actions)


def _run(envs: Any, actions: list[np.ndarray[Any, Any]]) -> int:
    for action in actions:
        envs.step(action)
    return sum(map(len, actions))


if __name__ == "__main__":
    main()
