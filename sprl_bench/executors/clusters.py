"""Runs as tasks of a Ray cluster or as jobs of a Slurm cluster; both are tested against stand-ins only."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import Any, Final

from sprl_bench.executors.base import Executor, WorkerDiedError, worker_environment
from sprl_bench.extras import require_extra
from sprl_bench.records import RunSpec

POLL_S: Final = 1.0  # seconds between two looks at what has ended


class RayExecutor(Executor):
    """A task of a Ray cluster for each run; all nodes must see the runs' folder."""

    def __init__(self, workers: int = 0) -> None:
        super().__init__(workers)
        self._ray = require_extra("ray")
        self._ray.init(ignore_reinit_error=True)

    def _start(self, function: Callable[[RunSpec], Any], spec: RunSpec) -> Any:
        options = {
            "num_cpus": spec.torch_threads,
            "num_gpus": int(spec.device.startswith("cuda")),
            "max_retries": 0,
            "runtime_env": {"env_vars": worker_environment(spec)},
        }
        return self._ray.remote(function).options(**options).remote(spec)

    def _ended(self, calls: Sequence[Any]) -> Sequence[Any]:
        ended: Sequence[Any] = self._ray.wait(list(calls), num_returns=1)[0]
        return ended

    def _result(self, call: Any) -> Any:
        try:
            return self._ray.get(call)
        except Exception as error:  # whatever Ray makes of a crash must not stop the other runs
            return WorkerDiedError(str(error))

    def _stop(self, calls: Sequence[Any]) -> None:
        for task in calls:
            self._ray.cancel(task)


class SlurmExecutor(Executor):
    """A Slurm job for each run; the SBATCH_ variables of the shell give partition, account and time limit."""

    def __init__(self, workers: int = 0) -> None:
        super().__init__(workers)
        self._submitit = require_extra("submitit")

    def _start(self, function: Callable[[RunSpec], Any], spec: RunSpec) -> Any:
        executor = self._submitit.AutoExecutor(folder="slurm-logs")
        executor.update_parameters(
            name=f"{spec.agent}-{spec.task.name}-{spec.seed}",
            cpus_per_task=spec.torch_threads,
            gpus_per_node=int(spec.device.startswith("cuda")),
            timeout_min=24 * 60,
            slurm_setup=[f"export {name}={value}" for name, value in worker_environment(spec).items()],
        )
        return executor.submit(function, spec)

    def _ended(self, calls: Sequence[Any]) -> Sequence[Any]:
        ended = [job for job in calls if job.done()]
        if not ended:
            time.sleep(POLL_S)
        return ended

    def _result(self, call: Any) -> Any:
        error = call.exception()
        return call.result() if error is None else WorkerDiedError(str(error))

    def _stop(self, calls: Sequence[Any]) -> None:
        for job in calls:
            job.cancel()
