"""Jobs of a Slurm cluster; tested against a stand-in only."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from typing import Any, Final

from sprl_bench.executors.extras import require_extra
from sprl_bench.executors.protocol import Result, WorkerDiedError
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
        waiting: deque[RunSpec] = deque(specs)
        running: dict[Any, RunSpec] = {}
        try:
            while waiting or running:
                while waiting and len(running) < (self.workers or len(specs)):
                    spec = waiting.popleft()
                    running[self._submit(function, spec)] = spec
                for job in [job for job in running if job.done()]:
                    yield running.pop(job), self._result(job)
                time.sleep(POLL_S)
        finally:
            for job in running:
                job.cancel()

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
