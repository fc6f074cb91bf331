"""How PPO's settings for the grids were chosen, where the paper's appendix gives none.

Two stages: all settings on FourRooms-7x7, then the better half on FourRooms-11x11 too; the mean of the two AUCs
decides. Run it by `python -m benchmarks.sweep_ppo_grid runs/sweep`; it resumes where it stopped. The
figures stand in docs/ppo-sweep.md.
"""

from __future__ import annotations

import itertools
import statistics
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from sprl_bench.executors import make_executor
from sprl_bench.progress import make_observer
from sprl_bench.records import find_records
from sprl_bench.suite import expand, run_suite
from sprl_bench.tasks import find_suite

Setting = Mapping[str, Any]

BUDGETS = {"FourRooms-7x7": 300_000, "FourRooms-11x11": 200_000}
SEEDS = (0,)
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


def aucs(task: str, settings: Sequence[Setting], root: Path) -> dict[str, float]:
    """Train with each setting on one task, and return the mean AUC over seeds by name."""
    for setting in settings:
        specs = expand(find_suite("grid"), ["ppo"], SEEDS, tasks=[task], budget=BUDGETS[task], overrides=dict(setting))
        run_suite(specs, root / name(setting), executor=make_executor("local", 0), observer=make_observer())
    found = {name(setting): find_records(root / name(setting)) for setting in settings}
    return {
        key: statistics.mean(record.scores.auc for record in records if record.spec.task.name.startswith(task))
        for key, records in found.items()
    }


def main(root: Path) -> None:
    """Run both stages and print every figure."""
    first = aucs("FourRooms-7x7", SETTINGS, root)
    better = sorted(SETTINGS, key=lambda setting: -first[name(setting)])[: len(SETTINGS) // 2]
    second = aucs("FourRooms-11x11", better, root)
    for key, auc in first.items():
        both = f"{second[key]:.3f}  {(auc + second[key]) / 2:.3f}" if key in second else "-      -"
        print(f"{key:30} {auc:.3f}  {both}")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
