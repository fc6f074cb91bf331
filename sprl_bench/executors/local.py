"""Processes of this machine."""

from __future__ import annotations

import contextlib
import faulthandler
import multiprocessing
import os
import signal
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from multiprocessing.connection import Connection, wait
from multiprocessing.context import SpawnProcess
from typing import Any, Final, Generic

from sprl_bench.executors.base import Result, WorkerDiedError, under_way, worker_environment
from sprl_bench.records import RunSpec

POLL_S: Final = 1.0  # seconds between two looks at what has ended
PATIENCE_S: Final = 120.0  # with a worker that was asked to stop: one update and one checkpoint


class LocalExecutor:
    """A fresh process for each run, some at a time: no run sees what another left behind, or goes down with it."""

    def __init__(self, workers: int = 0) -> None:
        self.workers = workers or len(os.sched_getaffinity(0))

    def map(
        self, function: Callable[[RunSpec], Result], specs: Sequence[RunSpec]
    ) -> Iterator[tuple[RunSpec, Result | WorkerDiedError]]:
        """Call `function` on each spec in a process of its own; see `Executor`."""
        calls = under_way(specs, self.workers, start=partial(_Worker, function), ended=_ended, stop=_stop)
        with contextlib.closing(calls):
            for spec, worker in calls:
                yield spec, worker.result()


class _Worker(Generic[Result]):
    """One call in one process."""

    def __init__(self, function: Callable[[RunSpec], Result], spec: RunSpec) -> None:
        context = multiprocessing.get_context("spawn")
        self.receiver, sender = context.Pipe(duplex=False)
        self.process: SpawnProcess = context.Process(target=_work, args=(function, spec, sender), name=str(spec.seed))
        with _environment_set(worker_environment(spec)):
            self.process.start()
        sender.close()

    def result(self) -> Result | WorkerDiedError:
        """Wait for the process to end and return what came of it."""
        try:
            result: Result = self.receiver.recv()
        except EOFError:
            self.process.join()
            return WorkerDiedError(_cause(self.process.exitcode))
        finally:
            self.receiver.close()
        self.process.join()
        return result


def _work(function: Callable[[RunSpec], Any], spec: RunSpec, sender: Connection[Any, Any]) -> None:
    """Be a worker: the parent hears of Ctrl-C too, and asks by SIGTERM; a crash leaves a traceback."""
    faulthandler.enable()
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    result = function(spec)
    with contextlib.suppress(BrokenPipeError):  # the parent has died; nobody is left to hear of it
        sender.send(result)


def _ended(running: Sequence[_Worker[Result]]) -> list[_Worker[Result]]:
    """Wait until a worker has a result or has died; return those, maybe none."""
    ready = wait([worker.receiver for worker in running], timeout=POLL_S)
    return [worker for worker in running if worker.receiver in ready or not worker.process.is_alive()]


def _stop(workers: Sequence[_Worker[Any]]) -> None:
    """Ask each worker to end after its current update; insist after a while, or at once on a second Ctrl-C."""
    try:
        for worker in workers:
            worker.process.terminate()
        deadline = time.monotonic() + PATIENCE_S
        for worker in workers:
            worker.process.join(max(0.0, deadline - time.monotonic()))
    finally:
        for worker in workers:
            worker.process.kill()
            worker.process.join()


def _cause(exit_code: int | None) -> str:
    if exit_code is None or exit_code >= 0:
        return f"the worker ended with exit status {exit_code} and no result"
    name = signal.Signals(-exit_code).name
    hint = " (out of memory?)" if name == "SIGKILL" else ""
    return f"the worker was ended by {name}{hint}"


@contextlib.contextmanager
def _environment_set(variables: Mapping[str, str]) -> Iterator[None]:
    """Set environment variables for the processes that are started within."""
    before = {name: os.environ.get(name) for name in variables}
    os.environ.update(variables)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value
