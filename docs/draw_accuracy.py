"""Draw how well the reachability network learns: `python docs/draw_accuracy.py RUNS docs/accuracy.png`.

RUNS are made by `sprl-bench run --suite grid --agents sprl --budget 400000 --seeds 50, --set learning_rate=0.003 --set
cost_scale=0.01 --out RUNS`. Every figure of docs/accuracy.md is printed: what the network reached, and what the exact
search scores by the same measure on the steps of a uniformly random policy and of the policy that each run ended with.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import NamedTuple

import gymnasium
import matplotlib as mpl
import numpy as np
import torch

from sprl_baselines.reachability.config import ReachabilityConfig
from sprl_baselines.reachability.replay import Replay
from sprl_baselines.reachability.triplets import accuracy_ranges, scatter
from sprl_bench import solver
from sprl_bench.policies import Actor, find_actor
from sprl_bench.records import RunRecord, find_records

mpl.use("Agg")
from matplotlib import pyplot

BAR = 0.8
AT = (100_000, 200_000, 300_000, 400_000)  # env steps of the printed figures, each the mean of the 50 000 before it
WINDOW = 50_000
EXPERIENCE = 24_000  # env steps that the exact search is measured on
NUM_ENVS = 12

Points = list[tuple[int, float]]


def measured(run: Path) -> Points:
    """Return the env steps and the accuracy of every measurement of a run."""
    lines = map(json.loads, (run / "metrics.jsonl").read_text().splitlines())
    return [(line["env_steps"], line["reachability_accuracy"]) for line in lines if "reachability_accuracy" in line]


class Search(NamedTuple):
    """What the exact search says of pairs drawn as the measure draws them."""

    positives_near: float  # share that is within k steps
    negatives_near: float  # the same of those that count as out of reach

    @property
    def accuracy(self) -> float:
        """The share of right answers by the measure."""
        return (self.positives_near + 1 - self.negatives_near) / 2


def search(actor: Actor, env_id: str, config: ReachabilityConfig) -> Search:
    """Put the exact search to the measure on what an actor sees."""
    replay = experience(actor, env_id)
    ranges = accuracy_ranges(config.k, config.tolerance, config.negative_bias)
    triplets = scatter(replay.segments(), ranges, config.accuracy_pairs, torch.Generator().manual_seed(0))
    anchors, positives, negatives = (replay.take(places).numpy() for places in triplets)
    near = (float(solver.reachable(anchors, others, config.k).mean()) for others in (positives, negatives))
    return Search(*near)


def experience(actor: Actor, env_id: str) -> Replay:
    """Return what an actor sees from seed 0 on."""
    act = actor.begin(gymnasium.make(env_id), 0)
    envs = gymnasium.make_vec(env_id, num_envs=NUM_ENVS)
    observations, _ = envs.reset(seed=0)
    replay = Replay(EXPERIENCE, NUM_ENVS)
    for _ in range(replay.capacity):
        actions = np.array([act(observation) for observation in observations])
        following, rewards, terminated, truncated, _ = envs.step(actions)
        cuts = terminated | truncated | (rewards != 0)
        replay.append(torch.from_numpy(observations[None]), torch.from_numpy(cuts[None]))
        observations = following
    return replay


def row(task: str, points: Points, by_random: Search, by_last: Search) -> str:
    """Return a row of a table: when the bar was first passed, means at some steps, and the exact search."""
    first = next((f"{steps:,}" for steps, accuracy in points if accuracy > BAR), "never")
    recent = [[accuracy for steps, accuracy in points if end - WINDOW < steps <= end] for end in AT]
    means = [f"{np.mean(some):.3f}" if some else "-" for some in recent]
    searched = [
        f"{found.accuracy:.3f} ({found.positives_near:.2f}, {found.negatives_near:.2f})"
        for found in (by_random, by_last)
    ]
    return f"| {' | '.join([task, first, *means, *searched])} |"


def draw(record: RunRecord, root: Path) -> None:
    """Draw one task's curve, with the exact search on a random policy's steps dotted, and print its figures."""
    task, env_id = record.spec.task.name.rpartition("-")[0], record.spec.task.env_id
    run = record.spec.path(root)
    points = measured(run)
    config = ReachabilityConfig.pick(record.spec.hyperparameters)
    by_random, by_last = (search(find_actor(who), env_id, config) for who in ("random", run))
    [line] = pyplot.plot(*zip(*points, strict=True), label=task, linewidth=1.4)
    pyplot.axhline(by_random.accuracy, color=line.get_color(), linestyle=":", linewidth=1)
    print(row(task, points, by_random, by_last))


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
