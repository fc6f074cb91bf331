"""Calls under way: some at a time, each given back as it ends, and all stopped when nobody asks for more."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Generator, Hashable, Iterable, Sequence
from typing import TypeVar

from sprl_bench.records import RunSpec

__all__ = ["under_way"]

Call = TypeVar("Call", bound=Hashable)


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
