"""The environment variables of a worker."""

from __future__ import annotations

from typing import Final

from sprl_bench.records import RunSpec

__all__ = ["worker_environment"]

THREAD_POOLS: Final = (
    "OMP_NUM_THREADS",
    "MKL_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "NUMBA_NUM_THREADS",
    "NUMEXPR_NUM_THREADS",
    "VECLIB_MAXIMUM_THREADS",
)


def worker_environment(spec: RunSpec) -> dict[str, str]:
    """Return what must be set before a worker imports anything: its threads, and an order of sets that never varies."""
    threads = dict.fromkeys(THREAD_POOLS, str(spec.torch_threads))
    return {**threads, "PYTHONHASHSEED": "0", "CUBLAS_WORKSPACE_CONFIG": ":4096:8"}
