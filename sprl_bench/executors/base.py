"""What all executors share: their one shape, calls under way, and the environment of a worker."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Generator, Hashable, Iterable, Iterator, Sequence
from typing import Final, Protocol, TypeVar

from sprl_bench.records import RunSpec

Result = TypeVar("Result")
Call = TypeVar("Call", bound=Hashable)
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


class Executor(Protocol):
    """Maps a function over specs."""

    def map(
        self, function: Callable[[RunSpec], Result], specs: Sequence[RunSpec]
    ) -> Iterator[tuple[RunSpec, Result | WorkerDiedError]]:
        """Call `function` on each spec, in any order, and yield what comes back as it comes.

        The function and its results are pickled on their way. Closing the iterator asks the calls that are under way
        to stop and waits for them.
        """
        ...


def under_way(
    specs: Sequence[RunSpec],
    limit: int,
    *,
    start: Callable[[RunSpec], Call],
    ended: Callable[[Sequence[Call]], Iterable[Call]],
    stop: Callable[[Sequence[Call]], None],
) -> Generator[tuple[RunSpec, Call]]:
    """Start a call for each spec, never more than `limit` at once, and yield both as the call ends.

    Args:
        specs: What is called for, in this order.
        limit: How many calls at once; 0 for all of them.
        start: Starts one.
        ended: Waits a while; returns those that have ended, maybe none.
        stop: Ends those that are under way when the generator is closed.
    """
    waiting: deque[RunSpec] = deque(specs)
    running: dict[Call, RunSpec] = {}
    try:
        while waiting or running:
            while waiting and len(running) < (limit or len(specs)):
                spec = waiting.popleft()
                running[start(spec)] = spec
            for call in ended(list(running)):
                yield running.pop(call), call
    finally:
        stop(list(running))


def worker_environment(spec: RunSpec) -> dict[str, str]:
    """Return what must be set before a worker imports anything: its threads, and an order of sets that never varies."""
    threads = dict.fromkeys(THREAD_POOLS, str(spec.torch_threads))
    return {**threads, "PYTHONHASHSEED": "0", "CUBLAS_WORKSPACE_CONFIG": ":4096:8"}
