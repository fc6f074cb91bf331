"""Tasks of a Ray cluster; tested against a stand-in only."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from typing import Any

from sprl_bench.executors.extras import require_extra
from sprl_bench.executors.protocol import Result, WorkerDiedError
from sprl_bench.executors.variables import worker_environment
from sprl_bench.records import RunSpec

__all__ = ["RayExecutor"]


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
        waiting: deque[RunSpec] = deque(specs)
        running: dict[Any, RunSpec] = {}
        try:
            while waiting or running:
                while waiting and len(running) < (self.workers or len(specs)):
                    spec = waiting.popleft()
                    running[self._submit(function, spec)] = spec
                for task in self._ray.wait(list(running), num_returns=1)[0]:
                    yield running.pop(task), self._result(task)
        finally:
            for task in running:
                self._ray.cancel(task)

    def _submit(self, function: Callable[[RunSpec], Any], spec: RunSpec) -> Any:
        options = {
            "num_cpus": spec.torch_threads,
            "num_gpus": int(spec.device.startswith("cuda")),
            "max_retries": 0,
            "runtime_env": {"env_vars": worker_environment(spec)},
        }
        return self._ray.remote(function).options(**options).remote(spec)

    def _result(self, task: Any) -> Any:
        try:
            return self._ray.get(task)
        except Exception as error:  # whatever Ray makes of a crash must not stop the other runs
            return WorkerDiedError(str(error))
