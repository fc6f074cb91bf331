"""Tasks of a Ray cluster; tested against a stand-in only."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Any

from sprl_bench.executors.extras import require_extra
from sprl_bench.executors.protocol import Result, WorkerDiedError
from sprl_bench.executors.under_way import under_way
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
