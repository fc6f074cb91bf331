"""Contenders whose rates are known."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Callable

import numpy as np

from benchmarks.jax_cores import limit_jax


def steady(steps: int, seconds: float, megabytes: int = 0) -> Callable[[], int]:
    print("a greeting, which is no answer")

    def turn() -> int:
        np.ones(megabytes * 125_000)
        time.sleep(seconds)
        return steps

    return turn


def above_another(megabytes: int) -> Callable[[], int]:
    """A contender whose work is done by a process below it."""
    work = f"import time; b'1' * {megabytes * 1_000_000}; time.sleep(60)"
    below = subprocess.Popen([sys.executable, "-c", work])

    def turn() -> int:
        time.sleep(1)
        below.kill()
        below.wait()
        return 1

    return turn


def broken() -> Callable[[], int]:
    raise ZeroDivisionError


def limited(num_cores: int) -> Callable[[], int]:
    limit_jax(num_cores)

    def turn() -> int:
        time.sleep(0.01)
        return len(os.sched_getaffinity(0))

    return turn
