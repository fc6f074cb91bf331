"""State of the process, set for a run and restored after it: torch's modes and the signal handlers."""

from __future__ import annotations

import contextlib
import signal
import sys
import threading
from collections.abc import Iterator
from types import FrameType
from typing import Any, Self

from sprl_bench.records import RunSpec


@contextlib.contextmanager
def torch_set_up(spec: RunSpec) -> Iterator[None]:
    """Set torch's modes for a run, if the agent has loaded torch, and restore them after it.

    Sets the threads and flushes denormal numbers to 0; on a GPU it also chooses deterministic algorithms, and torch
    warns of those that it lacks.
    """
    torch = sys.modules.get("torch")
    if torch is None:
        yield
        return
    threads, flushed = torch.get_num_threads(), float.fromhex("0x1p-1022") * 0.5 == 0.0
    deterministic = torch.are_deterministic_algorithms_enabled()
    warns = torch.is_deterministic_algorithms_warn_only_enabled()
    torch.set_num_threads(spec.torch_threads)
    torch.set_flush_denormal(True)
    if spec.device != "cpu":
        torch.use_deterministic_algorithms(True, warn_only=True)
    try:
        yield
    finally:
        torch.set_num_threads(threads)
        torch.set_flush_denormal(flushed)
        torch.use_deterministic_algorithms(deterministic, warn_only=warns)


class StopSignals:
    """Turns the first SIGTERM or SIGINT into a request to stop; the second one acts as usual.

    An ignored signal stays ignored: workers ignore Ctrl-C, since the parent receives it too and stops them.
    """

    def __init__(self) -> None:
        self.received = False
        self._before: dict[signal.Signals, Any] = {}

    def __enter__(self) -> Self:
        if threading.current_thread() is threading.main_thread():
            for number in (signal.SIGTERM, signal.SIGINT):
                if signal.getsignal(number) is not signal.SIG_IGN:
                    self._before[number] = signal.signal(number, self._receive)
        return self

    def __exit__(self, *_: object) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def _receive(self, _number: int, _frame: FrameType | None) -> None:
        self.received = True
        self.__exit__()
