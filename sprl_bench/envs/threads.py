"""Splits work on N sub-environments into slices, one for each thread."""

from __future__ import annotations

import itertools
import os
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any

from sprl_bench.envs.checks import check_integer


def usable_cores() -> int:
    """Return the number of cores that this process may run on."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


class Threads:
    """Calls a function on independent slices of `range(size)` in parallel.

    This is only faster if the function releases the interpreter lock. Threads start on first use, in the process that
    uses them: an object that was pickled, copied or inherited by a fork starts its own.

    Args:
        num_threads: The largest number of threads; None for the number of usable cores.
        grain: The smallest slice. Work for fewer than two slices is done by the caller's thread.
    """

    def __init__(self, num_threads: int | None, grain: int) -> None:
        self.count = usable_cores() if num_threads is None else check_integer("num_threads", num_threads, 1)
        self.grain = grain
        self._pool: ThreadPoolExecutor | None = None
        self._owner = -1

    def map(self, function: Callable[..., None], size: int, *arguments: Any) -> None:
        """Call `function(start, stop, *arguments)` on slices that cover `range(size)`, and wait for all."""
        slices = min(self.count, size // self.grain)
        if slices < 2:
            function(0, size, *arguments)
            return
        bounds = [size * index // slices for index in range(slices + 1)]
        pool = self._started()
        (own_start, own_stop), *rest = itertools.pairwise(bounds)
        others: list[Future[None]] = [pool.submit(function, start, stop, *arguments) for start, stop in rest]
        function(own_start, own_stop, *arguments)
        for other in others:
            other.result()

    def close(self) -> None:
        """Stop the threads that this process started, if any."""
        if self._pool is not None and self._owner == os.getpid():
            self._pool.shutdown()
        self._pool = None

    def _started(self) -> ThreadPoolExecutor:
        if self._pool is None or self._owner != os.getpid():
            self._pool = ThreadPoolExecutor(self.count - 1, thread_name_prefix="sprl-bench")
            self._owner = os.getpid()
        return self._pool

    def __getstate__(self) -> dict[str, Any]:
        """Exclude the threads."""
        return {**self.__dict__, "_pool": None}
