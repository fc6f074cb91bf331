"""Processes of this machine."""

from __future__ import annotations

import contextlib
import faulthandler
import multiprocessing
import os
import signal
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from multiprocessing.connection import Connection, wait
from multiprocessing.context import SpawnProcess
from typing import Any, Final

from sprl_bench.executors.base import Executor, Resources, WorkerDiedError, worker_environment
from sprl_bench.records import RunSpec

POLL_S: Final = 1.0  # seconds between two looks at what has ended
PARTING_S: Final = 10.0  # with a worker that has returned its result
PATIENCE_S: Final = 120.0  # with a worker that was asked to stop: one update and one checkpoint


class LocalExecutor(Executor):
    """A fresh process for each run: no run sees the state of another, or ends with it."""

    def __init__(self, workers: int = 0, resources: Resources = Resources()) -> None:  # noqa: B008 - it is frozen
        if resources != Resources():
            raise ValueError("executor is 'local'; it must be 'ray' or 'slurm' for resources of each run.")
        super().__init__(workers or len(os.sched_getaffinity(0)))

    def _start(self, function: Callable[[RunSpec], Any], spec: RunSpec) -> _Worker:
        return _Worker(function, spec)

    def _ended(self, calls: Sequence[_Worker]) -> list[_Worker]:
        ready = wait([worker.receiver for worker in calls], timeout=POLL_S)
        return [worker for worker in calls if worker.receiver in ready or not worker.process.is_alive()]

    def _result(self, call: _Worker) -> Any:
        """Wait for the process to end and return its result."""
        try:
            result = call.receiver.recv()
        except EOFError:
            call.process.join()
            return WorkerDiedError(_cause(call.process.exitcode))
        finally:
            call.receiver.close()
        call.process.join(PARTING_S)
        if call.process.is_alive():  # an agent has left a thread, or a child process, that does not end
            call.process.kill()
            call.process.join()
        return result

    def _stop(self, calls: Sequence[_Worker]) -> None:
        """Ask each worker to end after its current update; kill it after a while, or at once on a second Ctrl-C."""
        try:
            for worker in calls:
                worker.process.terminate()
            deadline = time.monotonic() + PATIENCE_S
            for worker in calls:
                worker.process.join(max(0.0, deadline - time.monotonic()))
        finally:
            for worker in calls:
                worker.process.kill()
                worker.process.join()


class _Worker:
    """One call in one process."""

    def __init__(self, function: Callable[[RunSpec], Any], spec: RunSpec) -> None:
        context = multiprocessing.get_context("spawn")
        self.receiver, sender = context.Pipe(duplex=False)
        self.process: SpawnProcess = context.Process(
            target=_work, args=(function, spec, sender, os.getpid()), name=str(spec.seed)
        )
        with _environment_set(worker_environment(spec)):
            self.process.start()
        sender.close()


def _work(function: Callable[[RunSpec], Any], spec: RunSpec, sender: Connection[Any, Any], parent: int) -> None:
    """Be a worker. Ctrl-C reaches the parent too, which then sends SIGTERM; a crash prints a traceback."""
    if os.getppid() != parent:  # it died while this process loaded its modules
        return
    faulthandler.enable()
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    result = function(spec)
    with contextlib.suppress(BrokenPipeError):  # the parent has died
        sender.send(result)


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
        for name in variables:
            del os.environ[name]
        os.environ.update({name: value for name, value in before.items() if value is not None})
