"""Two seeds with two workers, against twice the speed of one seed alone: how much workers slow each other down.

Each measurement runs a whole suite: processes that start, import, train and write a record.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

from benchmarks.measure import Row, compare
from sprl_bench.executors import make_executor
from sprl_bench.suite import expand, run_suite
from sprl_bench.tasks import find_suite

BUDGET = 60_000
BAR = 0.9
REPEATS = 5


def rows() -> list[Row]:
    """Measure the row; takes a few minutes on two cores."""
    return [
        compare(
            "two seeds of PPO, FourRooms 7x7, 2 workers",
            lambda: _train(seeds=2, workers=2),
            "twice one seed, 1 worker",
            lambda: 2 * _train(seeds=1, workers=1),
            bar=BAR,
            repeats=REPEATS,
        )
    ]


def _train(seeds: int, workers: int) -> int:
    """Train these seeds and return their environment steps."""
    specs = expand(find_suite("smoke"), ["ppo"], range(seeds), budget=BUDGET)
    with tempfile.TemporaryDirectory() as out:
        outcomes = run_suite(specs, Path(out), executor=make_executor("local", workers))
    failed = [outcome.error for outcome in outcomes if outcome.status != "finished"]
    if failed:
        raise RuntimeError(failed[0])
    return seeds * BUDGET
