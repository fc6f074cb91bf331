"""How PPO's settings for the grids are chosen, where the paper's appendix gives none.

Every setting trains on both FourRooms with every seed; the mean of the two tasks' AUCs decides. What is run is
declared here and in docs/ppo-sweep.md before it is run. `python -m benchmarks.sweep_ppo_grid runs/sweep` runs it,
two runs at once or as many as its second argument says, and resumes where it stopped.
"""

from __future__ import annotations

import itertools
import statistics
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from sprl_bench.executors import make_executor
from sprl_bench.progress import make_observer
from sprl_bench.records import find_records
from sprl_bench.suite import expand, run_suite
from sprl_bench.tasks import find_suite

Setting = Mapping[str, Any]

TASKS = ("FourRooms-11x11", "FourRooms-7x7")  # the longer first, so that workers end together
BUDGET = 300_000
SEEDS = (0, 1)
SETTINGS: list[Setting] = [
    {
        "clip_range": clip_range,
        "anneal_clip_range": anneal,
        "anneal_learning_rate": anneal,
        "rollout_length": rollout_length,
    }
    for clip_range, anneal, rollout_length in itertools.product((0.2, 0.1), (False, True), (128, 256))
]


def name(setting: Setting) -> str:
    """Return what the folder of a setting is called."""
    annealed = "annealed" if setting["anneal_clip_range"] else "constant"
    return f"clip-{setting['clip_range']}-{annealed}-length-{setting['rollout_length']}"


def train(setting: Setting, root: Path, workers: int) -> None:
    """Train with one setting on both tasks with every seed, and leave the records under `root`."""
    specs = expand(find_suite("grid"), ["ppo"], SEEDS, tasks=TASKS, budget=BUDGET, overrides=dict(setting))
    run_suite(specs, root / name(setting), executor=make_executor("local", workers), observer=make_observer())


def aucs(setting: Setting, root: Path) -> dict[str, list[float]]:
    """Return each task's AUCs, one a seed."""
    records = find_records(root / name(setting))
    return {task: [r.scores.auc for r in records if r.spec.task.name.startswith(task)] for task in TASKS}


def main(root: Path, workers: int = 2) -> None:
    """Run the sweep and print every AUC, the best setting first."""
    rows = []
    for setting in SETTINGS:
        train(setting, root, workers)
        of_tasks = aucs(setting, root)
        mean = statistics.mean(statistics.mean(of_task) for of_task in of_tasks.values())
        rows.append((mean, name(setting), of_tasks))
    for mean, key, of_tasks in sorted(rows, key=lambda row: -row[0]):
        figures = "  ".join(f"{auc:.3f}" for of_task in of_tasks.values() for auc in of_task)
        print(f"{key:30} {figures}  mean {mean:.3f}")


if __name__ == "__main__":
    main(Path(sys.argv[1]), *map(int, sys.argv[2:3]))
