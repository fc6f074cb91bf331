"""The same runs in any order: shuffled, by any executor, some of them interrupted before.

As a program it runs them: `python shuffled_suites.py OUT EXECUTOR WORKERS ORDER`.
"""

from __future__ import annotations

import contextlib
import os
import random
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from run_files import files_of

from entries import make_entry
from sprl_bench.executors import clusters, make_executor
from sprl_bench.records import RunRecord, RunSpec, find_records
from sprl_bench.run import InterruptedRunError, run
from sprl_bench.suite import expand, run_suite
from sprl_bench.tables import render, tabulate
from sprl_bench.tasks import find_suite


def specs() -> list[RunSpec]:
    """Return runs of which five make an entry, and others whose agent learns."""
    whole = expand(find_suite("smoke"), ["random"], range(5), device="cpu")
    learning = expand(find_suite("grid-7x7"), ["ppo"], range(1), budget=4_000, device="cpu")
    return [*whole, *learning]


def results_of(out: Path) -> dict[str, Any]:
    """Return all that a folder of these runs says: files, tables and the entry, without times."""
    records = [_lasting(one) for one in find_records(out)]
    entry = make_entry(records, agent="random")
    return {"files": files_of(out), "tables": render(tabulate(records), "json"), "entry": entry}


def _lasting(record: RunRecord) -> RunRecord:
    """Return a record without its time, and without the packages that only some processes have loaded."""
    versions = {name: record.versions[name] for name in ("python", "numpy", "sprl-bench")}
    return record.model_copy(update={"wall_time_s": 0.0, "versions": versions})


def interrupt(spec: RunSpec, out: Path) -> None:
    """Begin a run, or continue it, and stop it at its next report."""
    with contextlib.suppress(InterruptedRunError):
        run(spec, out, stop=lambda: True)


class TakingTurns:
    """Runs in this process, the first `workers` of them by turns: each may be interrupted before it is finished."""

    def __init__(self, workers: int, interruptions: int, order: random.Random, out: Path) -> None:
        self._workers, self._interruptions, self._order, self._out = workers, interruptions, order, out

    def map(self, function: Any, waiting: Sequence[RunSpec]) -> Iterator[tuple[RunSpec, Any]]:
        """Yield each run's result."""
        left, begun = list(waiting), []
        while left or begun:
            while left and len(begun) < self._workers:
                begun.append((left.pop(0), self._interruptions))
            spec, interruptions = begun.pop(self._order.randrange(len(begun)))
            if interruptions:
                interrupt(spec, self._out)
                begun.append((spec, interruptions - 1))
            else:
                yield spec, function(spec)


def run_shuffled(executor: str, workers: int, order: int, out: Path, environment: Mapping[str, str]) -> None:
    """Run all in a process of its own."""
    words = [__file__, str(out), executor, str(workers), str(order)]
    path = os.pathsep.join([str(Path(__file__).parent), environment.get("PYTHONPATH", "")])
    done = subprocess.run(
        [sys.executable, *words],
        check=False,
        cwd=out.parent,
        env={**environment, "PYTHONPATH": path},
        capture_output=True,
        text=True,
        timeout=400,
    )
    assert done.returncode == 0, done.stdout + done.stderr


def main(out: Path, executor: str, workers: int, seed: int) -> None:
    """Run all, in an order of that seed; some of them have been interrupted before."""
    order, shuffled = random.Random(seed), specs()
    order.shuffle(shuffled)
    for spec in shuffled[::3]:
        interrupt(spec, out)
    clusters.CLUSTER, clusters.POLL_S = "local", 0.2  # submitit's own stand-in for Slurm
    outcomes = run_suite(shuffled, out, executor=make_executor(executor, workers))
    assert not [one.error for one in outcomes if one.error], outcomes


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2], int(sys.argv[3]), int(sys.argv[4]))
