"""Where runs are worked on: processes of this machine, a Ray cluster, or Slurm. One small shape for all.

An executor maps a function over specs and gives back each result as it comes. It knows nothing of what the function
does, except that each call needs as many threads as its spec says and may bring its process down.

Ray and Slurm are thin and are tested against stand-ins only: no cluster takes part in the tests.
"""

from __future__ import annotations

import contextlib
import faulthandler
import importlib
import multiprocessing
import os
import signal
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from multiprocessing.connection import Connection, wait
from multiprocessing.context import SpawnProcess
from typing import Any, Final, Generic, Protocol, TypeVar

from sprl_bench.records import RunSpec
from sprl_bench.suggestions import unknown

__all__ = ["Executor", "LocalExecutor", "RayExecutor", "SlurmExecutor", "WorkerDiedError", "make_executor"]

Result = TypeVar("Result")

POLL_S: Final = 1.0
PATIENCE_S: Final = 120.0  # with a worker that was asked to stop: one update and one checkpoint
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


def make_executor(name: str, workers: int) -> Executor:
    """Return the executor "local", "ray" or "slurm".

    Args:
        name: Which.
        workers: How many runs at once; 0 for one a core (local) or as many as the cluster takes (ray, slurm).

    Raises:
        ValueError: There is no such executor, or `workers` is not a count.
        ModuleNotFoundError: Its extra is not installed.
    """
    if name not in EXECUTORS:
        raise ValueError(unknown("executor", name, EXECUTORS))
    if isinstance(workers, bool) or not isinstance(workers, int) or workers < 0:
        raise ValueError(f"workers is {workers!r}; it must be an integer of at least 0 (0: one a core).")
    return EXECUTORS[name](workers)


def _environment(spec: RunSpec) -> dict[str, str]:
    """Return what must be set before a worker imports anything: its threads, and an order of sets that never varies."""
    threads = dict.fromkeys(THREAD_POOLS, str(spec.torch_threads))
    return {**threads, "PYTHONHASHSEED": "0", "CUBLAS_WORKSPACE_CONFIG": ":4096:8"}


class LocalExecutor:
    """A fresh process for each run, some at a time: no run sees what another left behind, or goes down with it."""

    def __init__(self, workers: int = 0) -> None:
        self.workers = workers or len(os.sched_getaffinity(0))

    def map(
        self, function: Callable[[RunSpec], Result], specs: Sequence[RunSpec]
    ) -> Iterator[tuple[RunSpec, Result | WorkerDiedError]]:
        """Call `function` on each spec in a process of its own; see `Executor`."""
        waiting = deque(specs)
        running: list[_Worker[Result]] = []
        try:
            while waiting or running:
                while waiting and len(running) < self.workers:
                    running.append(_Worker(function, waiting.popleft()))
                for worker in _ended(running):
                    running.remove(worker)
                    yield worker.spec, worker.result()
        finally:
            _stop(running)


class _Worker(Generic[Result]):
    """One call in one process."""

    def __init__(self, function: Callable[[RunSpec], Result], spec: RunSpec) -> None:
        self.spec = spec
        context = multiprocessing.get_context("spawn")
        self.receiver, sender = context.Pipe(duplex=False)
        self.process: SpawnProcess = context.Process(target=_work, args=(function, spec, sender), name=str(spec.seed))
        with _environment_set(_environment(spec)):
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
    sender.send(function(spec))


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


class RayExecutor:
    """A task of a Ray cluster for each run; the runs' folder must be on a file system that all nodes see."""

    def __init__(self, workers: int = 0) -> None:
        self._ray = _extra("ray")
        self.workers = workers

    def map(
        self, function: Callable[[RunSpec], Result], specs: Sequence[RunSpec]
    ) -> Iterator[tuple[RunSpec, Result | WorkerDiedError]]:
        """Call `function` on each spec as a task; see `Executor`."""
        self._ray.init(ignore_reinit_error=True)
        waiting: deque[RunSpec] = deque(specs)
        running: dict[Any, RunSpec] = {}
        try:
            while waiting or running:
                while waiting and len(running) < (self.workers or len(specs)):
                    spec = waiting.popleft()
                    running[self._submit(function, spec)] = spec
                for task in self._ray.wait(list(running), num_returns=1)[0]:
                    yield running.pop(task), self._result(task)
        finally:
            for task in running:
                self._ray.cancel(task)

    def _submit(self, function: Callable[[RunSpec], Any], spec: RunSpec) -> Any:
        options = {
            "num_cpus": spec.torch_threads,
            "num_gpus": int(spec.device.startswith("cuda")),
            "max_retries": 0,
            "runtime_env": {"env_vars": _environment(spec)},
        }
        return self._ray.remote(function).options(**options).remote(spec)

    def _result(self, task: Any) -> Any:
        try:
            return self._ray.get(task)
        except Exception as error:  # whatever Ray makes of a crash must not stop the other runs
            return WorkerDiedError(str(error))


class SlurmExecutor:
    """A Slurm job for each run; partition, account and time limit are taken from the SBATCH_ variables of the shell."""

    def __init__(self, workers: int = 0) -> None:
        self._submitit = _extra("submitit", extra="slurm")
        self.workers = workers

    def map(
        self, function: Callable[[RunSpec], Result], specs: Sequence[RunSpec]
    ) -> Iterator[tuple[RunSpec, Result | WorkerDiedError]]:
        """Call `function` on each spec as a job; see `Executor`."""
        waiting: deque[RunSpec] = deque(specs)
        running: dict[Any, RunSpec] = {}
        try:
            while waiting or running:
                while waiting and len(running) < (self.workers or len(specs)):
                    spec = waiting.popleft()
                    running[self._submit(function, spec)] = spec
                for job in [job for job in running if job.done()]:
                    yield running.pop(job), self._result(job)
                time.sleep(POLL_S)
        finally:
            for job in running:
                job.cancel()

    def _submit(self, function: Callable[[RunSpec], Any], spec: RunSpec) -> Any:
        executor = self._submitit.AutoExecutor(folder="slurm-logs")
        exports = [f"export {name}={value}" for name, value in _environment(spec).items()]
        executor.update_parameters(
            name=f"{spec.agent}-{spec.task.name}-{spec.seed}",
            cpus_per_task=spec.torch_threads,
            gpus_per_node=int(spec.device.startswith("cuda")),
            timeout_min=24 * 60,
            slurm_setup=exports,
        )
        return executor.submit(function, spec)

    def _result(self, job: Any) -> Any:
        error = job.exception()
        return job.result() if error is None else WorkerDiedError(str(error))


def _extra(module: str, extra: str | None = None) -> Any:
    """Import what only this executor needs.

    Raises:
        ModuleNotFoundError: It is not installed; the message says how to.
    """
    try:
        return importlib.import_module(module)
    except ModuleNotFoundError:
        raise ModuleNotFoundError(f"{module} is not installed: pip install 'sprl-bench[{extra or module}]'") from None


EXECUTORS: Final[Mapping[str, Callable[[int], Executor]]] = {
    "local": LocalExecutor,
    "ray": RayExecutor,
    "slurm": SlurmExecutor,
}
