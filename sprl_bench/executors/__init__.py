"""Where runs are computed: processes of this machine, a Ray cluster, or Slurm.

An executor maps a function over specs and yields the results as they arrive. A call needs the threads of its spec and
may crash its process.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Final

from sprl_bench.executors.base import Executor, Resources, WorkerDiedError
from sprl_bench.executors.clusters import RayExecutor, SlurmExecutor
from sprl_bench.executors.local import LocalExecutor
from sprl_bench.suggestions import unknown

__all__ = ["Executor", "LocalExecutor", "Resources", "WorkerDiedError", "make_executor"]

EXECUTORS: Final[Mapping[str, Callable[[int, Resources], Executor]]] = {
    "local": LocalExecutor,
    "ray": RayExecutor,
    "slurm": SlurmExecutor,
}


def make_executor(name: str, workers: int, resources: Resources = Resources()) -> Executor:  # noqa: B008 - it is frozen
    """Return the executor "local", "ray" or "slurm".

    Args:
        name: Which.
        workers: How many runs at once; 0 for one a core (local) or no limit (ray, slurm).
        resources: Of each run, on a cluster.

    Raises:
        ValueError: There is no such executor, `workers` is not a count, or this machine is given resources.
        NoClusterError: There is no cluster.
        ModuleNotFoundError: Its extra is not installed.
    """
    if name not in EXECUTORS:
        raise ValueError(unknown("executor", name, EXECUTORS))
    if isinstance(workers, bool) or not isinstance(workers, int) or workers < 0:
        raise ValueError(f"workers is {workers!r}; it must be an integer of at least 0 (0: one a core).")
    return EXECUTORS[name](workers, resources)
