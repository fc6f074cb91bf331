"""What all executors share: the loop over runs, and the environment of a worker."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable, Generator, Iterable, Sequence
from typing import Any, Final, TypeVar

from sprl_bench.records import RunSpec

Result = TypeVar("Result")
THREAD_POOLS: Final = (
    "OMP_NUM_THREADS",
    "MKL_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "NUMBA_NUM_THREADS",
    "NUMEXPR_NUM_THREADS",
    "VECLIB_MAXIMUM_THREADS",
)


class WorkerDiedError(RuntimeError):
    """A worker ended without a result: killed, out of memory, or crashed in compiled code."""


class Executor(ABC):
    """Maps a function over specs; a kind of executor says how a single call starts, ends and is stopped.

    Args:
        workers: How many calls at once; 0 for no limit.
    """

    def __init__(self, workers: int = 0) -> None:
        self.workers = workers

    def map(
        self, function: Callable[[RunSpec], Result], specs: Sequence[RunSpec]
    ) -> Generator[tuple[RunSpec, Result | WorkerDiedError]]:
        """Call `function` on each spec, in any order, and yield the results as they arrive.

        The function and its results are pickled. Closing the generator asks the running calls to stop and waits.
        """
        waiting, running = deque(specs), dict[Any, RunSpec]()
        try:
            while waiting or running:
                while waiting and len(running) < (self.workers or len(specs)):
                    spec = waiting.popleft()
                    running[self._start(function, spec)] = spec
                for call in self._ended(list(running)):
                    yield running.pop(call), self._result(call)
        finally:
            self._stop(list(running))

    @abstractmethod
    def _start(self, function: Callable[[RunSpec], Any], spec: RunSpec) -> Any:
        """Start a call and return a handle of it, which is hashable."""

    @abstractmethod
    def _ended(self, calls: Sequence[Any]) -> Iterable[Any]:
        """Wait for a while and return the calls that have ended, maybe none."""

    @abstractmethod
    def _result(self, call: Any) -> Any:
        """Return the result of a call that has ended, or a `WorkerDiedError`."""

    @abstractmethod
    def _stop(self, calls: Sequence[Any]) -> None:
        """Stop these calls."""


def worker_environment(spec: RunSpec) -> dict[str, str]:
    """Return the variables of a worker, set before it imports anything: its threads, and a fixed order of sets."""
    threads = dict.fromkeys(THREAD_POOLS, str(spec.torch_threads))
    return {**threads, "PYTHONHASHSEED": "0", "CUBLAS_WORKSPACE_CONFIG": ":4096:8"}
