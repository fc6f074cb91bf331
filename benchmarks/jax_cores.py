"""JAX on a number of processor cores: it has no setting of its own for that."""

from __future__ import annotations

import os


def limit_jax(num_cores: int) -> None:
    """Keep this process to so many cores, and JAX to the CPU; to be called before JAX is imported."""
    os.environ["JAX_PLATFORMS"] = "cpu"
    os.environ["XLA_FLAGS"] = f"--xla_cpu_multi_thread_eigen={str(num_cores > 1).lower()}"
    if hasattr(os, "sched_setaffinity"):  # Linux; elsewhere the flag is all there is
        os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[:num_cores])
