"""Jobs of a Slurm cluster; tested against a stand-in only."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Any, Final

from sprl_bench.executors.extras import require_extra
from sprl_bench.executors.protocol import Result, WorkerDiedError
from sprl_bench.executors.under_way import under_way
from sprl_bench.executors.variables import worker_environment
from sprl_bench.records import RunSpec

__all__ = ["SlurmExecutor"]

POLL_S: Final = 1.0  # seconds between two looks at what has ended


class SlurmExecutor:
    """A Slurm job for each run; partition, account and time limit are taken from the SBATCH_ variables of the shell."""

    def __init__(self, workers: int = 0) -> None:
        self._submitit = require_extra("submitit", extra="slurm")
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
