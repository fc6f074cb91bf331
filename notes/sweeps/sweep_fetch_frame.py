"""The frame of PPO on Fetch: what Table 5 does not print, settled by one declared sweep (notes/fetch-frame.md).

`python notes/sweeps/sweep_fetch_frame.py run OUT [PART/PARTS]` trains, and resumes where it stopped; parts divide the
settings among processes. `... report OUT` prints every AUC and the means, the best setting first.
"""

from __future__ import annotations

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

SEEDS = (100, 101, 102)
TASKS = {  # suite, env steps, and the discounts per reference action of 20 simulation steps
    "FetchReach-substep3": ("fetch-sparse", 250_000, {"gamma": 0.99 ** (3 / 20), "gae_lambda": 0.95 ** (3 / 20)}),
    "FetchReach": ("fetch", 120_000, {"gamma": 0.99, "gae_lambda": 0.95}),
}
PER_ACTION = {"gamma": 0.99, "gae_lambda": 0.95}
BASE: Mapping[str, Any] = {
    "num_envs": 30,
    "reward_normalization": "none",
    "clip_value": False,
    "entropy_coefficient": 0.0,
    "normalize_observations": True,
}
LANDED: Mapping[str, Any] = {
    "num_envs": 12,
    "reward_normalization": "extrinsic",
    "clip_value": True,
    "entropy_coefficient": 0.01,
    "normalize_observations": True,
}
SETTINGS: Mapping[str, Mapping[str, Any]] = {
    "base": BASE,
    "reward-extrinsic": {**BASE, "reward_normalization": "extrinsic"},
    "reward-extrinsic-clip10": {**BASE, "reward_normalization": "extrinsic", "reward_clip": 10.0},
    "value-clip": {**BASE, "clip_value": True},
    "per-action": {**BASE, **PER_ACTION},
    "envs-12": {**BASE, "num_envs": 12},
    "entropy-.001": {**BASE, "entropy_coefficient": 0.001},
    "entropy-.01": {**BASE, "entropy_coefficient": 0.01},
    "annealed": {**BASE, "anneal_learning_rate": True, "anneal_clip_range": True},
    "landed": {**LANDED, **PER_ACTION},
    # By the declared rule, once the ten were there: all levels that were better than the base by more than .01.
    "combination": {
        **BASE,
        "num_envs": 12,
        "reward_normalization": "extrinsic",
        "reward_clip": 10.0,
        "entropy_coefficient": 0.001,
    },
}


def run(out: Path, part: int, parts: int) -> None:
    """Train the settings of one part."""
    for number, (name, setting) in enumerate(SETTINGS.items()):
        if number % parts == part:
            _run_setting(out / name, setting)


def _run_setting(out: Path, setting: Mapping[str, Any]) -> None:
    for task, (suite, budget, discounts) in TASKS.items():
        specs = expand(
            find_suite(suite), ["ppo"], SEEDS, tasks=[task], budget=budget, overrides={**discounts, **setting}
        )
        run_suite(specs, out, executor=make_executor("local", 1), observer=make_observer())


def report(out: Path) -> str:
    """Return a line a setting: the AUC of each seed by task, and the mean over tasks of the means over seeds."""
    rows = {name: _aucs(out / name) for name in SETTINGS if (out / name).exists()}
    ranked = sorted(rows, key=lambda name: _mean(rows[name]), reverse=True)
    return "\n".join(_line(name, rows[name]) for name in ranked)


def _aucs(folder: Path) -> dict[str, list[float]]:
    records = [record for record in find_records(folder) if record.status == "complete"]
    return {
        task: [one.scores.auc for one in records if one.spec.task.name == f"{task}-{budget}"]
        for task, (_, budget, _) in TASKS.items()
    }


def _mean(by_task: Mapping[str, list[float]]) -> float:
    return statistics.mean(statistics.mean(aucs) if aucs else 0.0 for aucs in by_task.values())


def _line(name: str, by_task: Mapping[str, list[float]]) -> str:
    figures = "  ".join(f"{task} " + " ".join(f"{auc:.3f}" for auc in aucs) for task, aucs in by_task.items())
    return f"{name:26} {figures}  mean {_mean(by_task):.3f}"


if __name__ == "__main__":
    if sys.argv[1] == "run":
        run(Path(sys.argv[2]), *(map(int, sys.argv[3].split("/")) if len(sys.argv) > 3 else (0, 1)))
    else:
        print(report(Path(sys.argv[2])))
