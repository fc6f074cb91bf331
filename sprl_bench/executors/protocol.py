"""The one shape of all executors."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Protocol, TypeVar

from sprl_bench.records import RunSpec

__all__ = ["Executor", "Result", "WorkerDiedError"]

Result = TypeVar("Result")


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
