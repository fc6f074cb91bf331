"""Two seeds with two workers, against twice the speed of one seed alone: how much workers slow each other down.

Each measurement runs a whole suite: processes that start, import, train and write a record.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

from benchmarks.contenders import contender
from benchmarks.measure import Row, compare
from benchmarks.turns import Turn
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
            contender(training, seeds=2, workers=2, budget=BUDGET),
            "twice one seed, 1 worker",
            contender(training, seeds=1, workers=1, budget=BUDGET, counted=2),
            bar=BAR,
            repeats=REPEATS,
        )
    ]


def training(seeds: int, workers: int, budget: int, counted: int = 1) -> Turn:
    """Return turns that train so many seeds, `budget` env steps each; a step counts so many times."""
    return lambda: counted * _train(seeds, workers, budget)


def _train(seeds: int, workers: int, budget: int) -> int:
    """Train so many seeds and return their environment steps."""
    specs = expand(find_suite("smoke"), ["ppo"], range(seeds), budget=budget)
    with tempfile.TemporaryDirectory() as out:
        outcomes = run_suite(specs, Path(out), executor=make_executor("local", workers))
    failed = [outcome.error for outcome in outcomes if outcome.status != "finished"]
    if failed:
        raise RuntimeError(failed[0])
    return seeds * budget
