"""Draw how well the reachability network learns: `python docs/draw_accuracy.py RUNS docs/accuracy.png`.

RUNS are made by `sprl-bench run --suite grid --agents sprl --budget 400000 --seeds 50, --set learning_rate=0.003 --set
cost_scale=0.01 --out RUNS`. The figures of each task are printed as the rows of a table; beside them stands how
accurate the exact search is by the same measure, on what a uniformly random policy sees.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import gymnasium
import matplotlib as mpl
import numpy as np
import torch

from sprl_baselines.reachability.config import ReachabilityConfig
from sprl_baselines.reachability.replay import Replay
from sprl_baselines.reachability.triplets import accuracy_ranges, scatter
from sprl_bench import solver
from sprl_bench.records import RunRecord, find_records

mpl.use("Agg")
from matplotlib import pyplot

BAR = 0.8
AT = (100_000, 200_000, 300_000, 400_000)  # env steps of the printed figures, each the mean of the 50 000 before it
WINDOW = 50_000

NUM_ENVS = 12

Points = list[tuple[int, float]]


def measured(run: Path) -> Points:
    """Return the env steps and the accuracy of every measurement of a run."""
    lines = map(json.loads, (run / "metrics.jsonl").read_text().splitlines())
    return [(line["env_steps"], line["reachability_accuracy"]) for line in lines if "reachability_accuracy" in line]


def of_the_truth(env_id: str, config: ReachabilityConfig) -> float:
    """Return the accuracy of the exact search where actions are uniformly random (seed 0)."""
    envs = gymnasium.make_vec(env_id, num_envs=NUM_ENVS)
    observations, _ = envs.reset(seed=0)
    rng = np.random.default_rng(0)
    replay = Replay(config.replay_size, NUM_ENVS)
    for _ in range(replay.capacity):
        following, rewards, terminated, truncated, _ = envs.step(rng.integers(7, size=NUM_ENVS))
        cuts = terminated | truncated | (rewards != 0)
        replay.append(torch.from_numpy(observations[None]), torch.from_numpy(cuts[None]))
        observations = following
    ranges = accuracy_ranges(config.k, config.tolerance, config.negative_bias)
    triplets = scatter(replay.segments(), ranges, config.accuracy_pairs, torch.Generator().manual_seed(0))
    anchors, positives, negatives = (replay.take(places).numpy() for places in triplets)
    reached = solver.reachable(anchors, positives, config.k), solver.reachable(anchors, negatives, config.k)
    return float(reached[0].mean() + 1 - reached[1].mean()) / 2


def row(task: str, points: Points, truth: float) -> str:
    """Return a row of a table: when the bar was first passed, means at some steps, and the truth's accuracy."""
    first = next(f"{steps:,}" for steps, accuracy in points if accuracy > BAR)
    cells = []
    for end in AT:
        recent = [accuracy for steps, accuracy in points if end - WINDOW < steps <= end]
        cells.append(f"{sum(recent) / len(recent):.3f}")
    return f"| {task} | {first} | {' | '.join(cells)} | {truth:.3f} |"


def draw(record: RunRecord, root: Path) -> None:
    """Draw one task's curve, with the truth's accuracy as a dotted line, and print its figures."""
    task = record.spec.task.name.rpartition("-")[0]
    points = measured(record.spec.path(root))
    truth = of_the_truth(record.spec.task.env_id, ReachabilityConfig.pick(record.spec.hyperparameters))
    [line] = pyplot.plot(*zip(*points, strict=True), label=task, linewidth=1.4)
    pyplot.axhline(truth, color=line.get_color(), linestyle=":", linewidth=1)
    print(row(task, points, truth))


def main(root: str, path: str) -> None:
    """Draw all tasks in one panel."""
    pyplot.figure(figsize=(7, 3.6), layout="constrained")
    for record in find_records(Path(root)):
        draw(record, Path(root))
    pyplot.xlabel("environment steps")
    pyplot.ylabel("held-out accuracy")
    pyplot.ylim(0.45, 1)
    pyplot.legend(loc="lower right", frameon=False)
    pyplot.savefig(path, dpi=110)


if __name__ == "__main__":
    main(*sys.argv[1:3])
