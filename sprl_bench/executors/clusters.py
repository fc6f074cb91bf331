"""Runs as tasks of a Ray cluster or as jobs of a Slurm cluster; both are tested against stand-ins only."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Any, Final

from sprl_bench.executors.base import Result, WorkerDiedError, under_way, worker_environment
from sprl_bench.extras import require_extra
from sprl_bench.records import RunSpec

POLL_S: Final = 1.0  # seconds between two looks at what has ended


class RayExecutor:
    """A task of a Ray cluster for each run; the runs' folder must be on a file system that all nodes see."""

    def __init__(self, workers: int = 0) -> None:
        self._ray = require_extra("ray")
        self.workers = workers

    def map(
        self, function: Callable[[RunSpec], Result], specs: Sequence[RunSpec]
    ) -> Iterator[tuple[RunSpec, Result | WorkerDiedError]]:
        """Call `function` on each spec as a task; see `Executor`."""
        self._ray.init(ignore_reinit_error=True)
        tasks = under_way(
            specs, self.workers, start=partial(self._submit, function), ended=self._ended, stop=self._cancel
        )
        with contextlib.closing(tasks):
            for spec, task in tasks:
                yield spec, self._result(task)

    def _submit(self, function: Callable[[RunSpec], Any], spec: RunSpec) -> Any:
        options = {
            "num_cpus": spec.torch_threads,
            "num_gpus": int(spec.device.startswith("cuda")),
            "max_retries": 0,
            "runtime_env": {"env_vars": worker_environment(spec)},
        }
        return self._ray.remote(function).options(**options).remote(spec)

    def _ended(self, tasks: Sequence[Any]) -> Sequence[Any]:
        ended: Sequence[Any] = self._ray.wait(list(tasks), num_returns=1)[0]
        return ended

    def _cancel(self, tasks: Sequence[Any]) -> None:
        for task in tasks:
            self._ray.cancel(task)

    def _result(self, task: Any) -> Any:
        try:
            return self._ray.get(task)
        except Exception as error:  # whatever Ray makes of a crash must not stop the other runs
            return WorkerDiedError(str(error))


class SlurmExecutor:
    """A Slurm job for each run; partition, account and time limit are taken from the SBATCH_ variables of the shell."""

    def __init__(self, workers: int = 0) -> None:
        self._submitit = require_extra("submitit")
        self.workers = workers

    def map(
        self, function: Callable[[RunSpec], Result], specs: Sequence[RunSpec]
    ) -> Iterator[tuple[RunSpec, Result | WorkerDiedError]]:
        """Call `function` on each spec as a job; see `Executor`."""
        jobs = under_way(specs, self.workers, start=partial(self._submit, function), ended=_ended, stop=_cancel)
        with contextlib.closing(jobs):
            for spec, job in jobs:
                yield spec, self._result(job)

    def _submit(self, function: Callable[[RunSpec], Any], spec: RunSpec) -> Any:
        executor = self._submitit.AutoExecutor(folder="slurm-logs")
        exports = [f"export {name}={value}" for name, value in worker_environment(spec).items()]
        executor.update_parameters(
            name=f"{spec.agent}-{spec.task.name}-{spec.seed}",
            cpus_per_task=spec.torch_threads,
            gpus_per_node=int(spec.device.startswith("cuda")),
            timeout_min=24 * 60,
            slurm_setup=exports,
        )
        return executor.submit(function, spec)

    def _result(self, job: Any) -> Any:
        error = job.exception()
        return job.result() if error is None else WorkerDiedError(str(error))


def _ended(jobs: Sequence[Any]) -> Sequence[Any]:
    ended = [job for job in jobs if job.done()]
    if not ended:
        time.sleep(POLL_S)
    return ended


def _cancel(jobs: Sequence[Any]) -> None:
    for job in jobs:
        job.cancel()
