"""What all executors share: the loop over runs, and the environment of a worker."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable, Generator, Iterable, Sequence
from dataclasses import dataclass
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


@dataclass(frozen=True)
class Resources:
    """What one run asks of a cluster.

    Attributes:
        cores: CPU cores; 0 for one for each of its threads.
        gpu_share: Share of a GPU, if it computes on one.
        memory_gib: GiB of memory; 0 to ask for none.
    """

    cores: int = 0
    gpu_share: float = 1.0
    memory_gib: float = 0.0

    def __post_init__(self) -> None:
        if self.cores < 0:
            raise ValueError(f"cores is {self.cores}; it must be at least 0 (0: one a thread).")
        if not 0 < self.gpu_share <= 1:
            raise ValueError(f"gpu_share is {self.gpu_share}; it must be above 0 and at most 1.")
        if self.memory_gib < 0:
            raise ValueError(f"memory_gib is {self.memory_gib}; it must be at least 0 (0: any).")


class WorkerDiedError(RuntimeError):
    """A worker ended without a result: killed, out of memory, or crashed in compiled code."""


class Executor(ABC):
    """Maps a function over specs; a kind of executor says how a single call starts, ends and is stopped.

    Args:
        workers: How many calls at once; 0 for no limit.
        resources: Of each call, on a cluster.
    """

    def __init__(self, workers: int = 0, resources: Resources = Resources()) -> None:
        self.workers, self.resources = workers, resources

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
    """Return the variables of a worker, set before it imports anything.

    They are its threads, a fixed order of sets, and that no module is taken from the current folder unasked.
    """
    threads = dict.fromkeys(THREAD_POOLS, str(spec.torch_threads))
    return {**threads, "PYTHONHASHSEED": "0", "PYTHONSAFEPATH": "1", "CUBLAS_WORKSPACE_CONFIG": ":4096:8"}
