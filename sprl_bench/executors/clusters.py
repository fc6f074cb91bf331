"""Runs as tasks of a Ray cluster or as jobs of a Slurm cluster. All nodes must see the runs' folder."""

from __future__ import annotations

import os
import shutil
import signal
import socket
import time
from collections.abc import Callable, Sequence
from types import FrameType
from typing import Any, Final

from sprl_bench.executors.base import Executor, Resources, WorkerDiedError, worker_environment
from sprl_bench.extras import require_extra
from sprl_bench.records import RunSpec

POLL_S: Final = 1.0  # seconds between two looks at what has ended
PATIENCE_S: Final = 120.0  # with a run that was asked to stop: one update and one checkpoint
ANSWER_S: Final = 10.0  # for the first answer of a cluster's head
CLUSTER = "slurm"  # "local": submitit's stand-in on this machine
LOGS: Final = "slurm-logs"


class NoClusterError(ConnectionError):
    """There is no cluster to use."""


class RayExecutor(Executor):
    """A task of a running Ray cluster for each run.

    Args:
        workers: How many runs at once; 0 for as many as the cluster has room for.
        resources: Of each run.

    Raises:
        NoClusterError: No cluster is running here or at `RAY_ADDRESS`.
        ModuleNotFoundError: The extra `ray` is not installed.
    """

    def __init__(self, workers: int = 0, resources: Resources = Resources()) -> None:  # noqa: B008 - it is frozen
        super().__init__(workers, resources)
        self._ray = require_extra("ray")
        os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
        _refuse_silent(os.environ.get("RAY_ADDRESS", ""))
        try:
            self._ray.init("auto", ignore_reinit_error=True, log_to_driver=False, logging_level="error")
        except ConnectionError:
            raise NoClusterError(
                "executor is 'ray', but no cluster answers; start one with `ray start --head`, or set RAY_ADDRESS. A "
                "cluster that asks for a token needs the same one here."
            ) from None
        self._remote = self._ray.remote(_call)  # Ray takes functions alone, not everything that can be called

    def _start(self, function: Callable[[RunSpec], Any], spec: RunSpec) -> Any:
        resources = self.resources
        options = {
            "name": f"{spec.agent} on {spec.task.name}, seed {spec.seed}",
            "num_cpus": resources.cores or spec.torch_threads,
            "num_gpus": resources.gpu_share if spec.device.startswith("cuda") else 0,
            "memory": int(resources.memory_gib * 2**30) or None,
            "max_retries": 0,  # the suite itself tries again
            "runtime_env": {"env_vars": worker_environment(spec)},
        }
        return self._remote.options(**options).remote(function, spec)

    def _ended(self, calls: Sequence[Any]) -> Sequence[Any]:
        ended: Sequence[Any] = self._ray.wait(list(calls), num_returns=1, timeout=POLL_S)[0]
        return ended

    def _result(self, call: Any) -> Any:
        try:
            return self._ray.get(call)
        except Exception as error:  # whatever Ray makes of a crash must not stop the other runs
            return WorkerDiedError(_first_line(error))

    def _stop(self, calls: Sequence[Any]) -> None:
        """Interrupt the runs, as Ctrl-C does, and wait for their checkpoints."""
        if not calls:
            return
        for task in calls:
            self._ray.cancel(task)
        _, left = self._ray.wait(list(calls), num_returns=len(calls), timeout=PATIENCE_S)
        for task in left:
            self._ray.cancel(task, force=True)


def _refuse_silent(address: str) -> None:
    """Refuse an address, as HOST:PORT, where nothing listens: Ray would wait for minutes.

    Raises:
        NoClusterError: Nothing listens there.
    """
    host, _, port = address.rpartition(":")
    if not host or "/" in address or not port.isdecimal():
        return  # Ray knows other forms
    try:
        socket.create_connection((host.strip("[]"), int(port)), timeout=ANSWER_S).close()
    except (OSError, OverflowError) as error:
        raise NoClusterError(
            f"RAY_ADDRESS is {address!r}, but no cluster answers there ({error}); it must be that of a running head."
        ) from None


def _call(function: Callable[[RunSpec], Any], spec: RunSpec) -> Any:
    return function(spec)


def _first_line(error: Exception) -> str:
    return (str(error).strip() or type(error).__name__).splitlines()[0]


class SlurmExecutor(Executor):
    """A Slurm job for each run; the SBATCH_ variables of the shell give partition, account and time limit.

    A job that is preempted, or reaches its time limit, is queued again and continues from its last checkpoint.

    Args:
        workers: How many jobs at once; 0 for all.
        resources: Of each run.

    Raises:
        NoClusterError: This machine has no Slurm.
        ModuleNotFoundError: The extra `slurm` is not installed.
    """

    def __init__(self, workers: int = 0, resources: Resources = Resources()) -> None:  # noqa: B008 - it is frozen
        super().__init__(workers, resources)
        self._submitit = require_extra("submitit")
        if CLUSTER == "slurm" and shutil.which("srun") is None:
            raise NoClusterError("executor is 'slurm', but there is no `srun` here; start it on a node of the cluster.")

    def _start(self, function: Callable[[RunSpec], Any], spec: RunSpec) -> Any:
        executor = self._submitit.AutoExecutor(folder=LOGS, cluster=CLUSTER)
        memory = {"mem_gb": self.resources.memory_gib} if self.resources.memory_gib else {}
        executor.update_parameters(
            name=f"{spec.agent}-{spec.task.name}-{spec.seed}",
            cpus_per_task=self.resources.cores or spec.torch_threads,
            gpus_per_node=int(spec.device.startswith("cuda")),
            timeout_min=24 * 60,
            slurm_setup=[f"export {name}={value}" for name, value in worker_environment(spec).items()],
            **memory,
        )
        return executor.submit(_Requeued(function), spec)

    def _ended(self, calls: Sequence[Any]) -> Sequence[Any]:
        ended = [job for job in calls if job.done()]
        if not ended:
            time.sleep(POLL_S)
        return ended

    def _result(self, call: Any) -> Any:
        try:
            return call.result()
        except Exception as error:  # whatever submitit makes of a crash must not stop the other runs
            return WorkerDiedError(_first_line(error))

    def _stop(self, calls: Sequence[Any]) -> None:
        """Interrupt the jobs, as Ctrl-C does, and wait for their checkpoints."""
        for job in calls:
            job.cancel()
        deadline = time.monotonic() + PATIENCE_S
        while time.monotonic() < deadline and not all(job.done() for job in calls):
            time.sleep(POLL_S)


class _Requeued:
    """A function that submitit calls again, with the same argument, when its job was preempted.

    Slurm says so by SIGUSR2. The run is then stopped as by SIGTERM, so it ends its update and writes a checkpoint, and
    only then does submitit's own handler put the job back into the queue.
    """

    def __init__(self, function: Callable[[RunSpec], Any]) -> None:
        self._function = function

    def __call__(self, spec: RunSpec) -> Any:
        requeue: Any = signal.getsignal(signal.SIGUSR2)
        preempted: list[tuple[int, FrameType | None]] = []

        def stop(number: int, frame: FrameType | None) -> None:
            preempted.append((number, frame))
            signal.raise_signal(signal.SIGTERM)

        signal.signal(signal.SIGUSR2, stop)
        result = self._function(spec)
        if preempted and callable(requeue):
            requeue(*preempted[0])  # ends this process
        return result

    def checkpoint(self, spec: RunSpec) -> Any:
        """Return what is to be submitted instead; called by submitit in the job that has to end."""
        return require_extra("submitit").helpers.DelayedSubmission(self, spec)
