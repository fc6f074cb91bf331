"""Draw how well the reachability network learns: `python notes/draw_accuracy.py notes/accuracy.png RUNS...`.

RUNS are folders of runs by `sprl` and `eco`; notes/accuracy.md says how they are made. Prints the table of that page:
the accuracy of the networks over seeds, and what exact search scores by the same measure on the steps of a uniformly
random policy and of the policies that the runs ended with.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import gymnasium
import matplotlib as mpl
import numpy as np
import torch

from sprl_baselines.reachability.hyperparameters import ReachabilityConfig
from sprl_baselines.reachability.replay import Replay
from sprl_baselines.reachability.triplets import accuracy_ranges, scatter
from sprl_bench import solver
from sprl_bench.policies import Actor, find_actor
from sprl_bench.records import RunRecord, find_records

mpl.use("Agg")
from matplotlib import pyplot
from matplotlib.axes import Axes
from matplotlib.ticker import EngFormatter

BAR = 0.8
AT = (100_000, 200_000, 300_000, 400_000)  # env steps of the printed figures, each the mean of the 50 000 before it
WINDOW = 50_000
SHOWN = 500_000  # env steps in the picture
COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7")
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


def row(records: Sequence[RunRecord], curves: Sequence[Points], by_random: Search, by_last: Sequence[Search]) -> str:
    """Return a row of a table: when the bar was first passed, means at some steps, and the exact search."""
    spec = records[0].spec
    first = [next((steps for steps, accuracy in points if accuracy > BAR), None) for points in curves]
    passed = [steps for steps in first if steps is not None]
    when = f"{len(passed)} of {len(first)}" + (f": {min(passed):,} to {max(passed):,}" if passed else "")
    means = [spread([_recent(points, end) for points in curves]) for end in (*AT, spec.task.budget)]
    last = f"{spread([found.accuracy for found in by_last])} ({_shares(by_last)})"
    return f"| {' | '.join([spec.agent, _grid(records[0]), when, *means, f'{by_random.accuracy:.3f}', last])} |"


def _recent(points: Points, end: int) -> float:
    """Return the mean of the measurements in the steps before `end`, nan where there are none."""
    some = [accuracy for steps, accuracy in points if end - WINDOW < steps <= end]
    return float(np.mean(some)) if some else float("nan")


def spread(values: Sequence[float]) -> str:
    """Return the mean of a value over seeds, and the least and the largest."""
    return f"{np.nanmean(values):.3f} ({np.nanmin(values):.3f} to {np.nanmax(values):.3f})"


def _shares(found: Sequence[Search]) -> str:
    near = [np.mean([one.positives_near for one in found]), np.mean([one.negatives_near for one in found])]
    return ", ".join(f"{share:.2f}" for share in near)


def _grid(record: RunRecord) -> str:
    return record.spec.task.env_id.removeprefix("SPRL/").removesuffix("-v1")


def check(records: Sequence[RunRecord]) -> None:
    """Refuse runs that are not seeds of one and the same."""
    if len({(record.spec.hyperparameters_hash, record.spec.task.budget) for record in records}) > 1:
        raise SystemExit(f"The runs of {records[0].spec.agent} on {_grid(records[0])} differ in settings or budgets.")


def draw(axes: Axes, colour: str, records: Sequence[RunRecord], folders: Sequence[Path]) -> None:
    """Draw a task's seeds and their mean, with the exact search on random steps dotted, and print its figures."""
    check(records)
    env_id = records[0].spec.task.env_id
    config = ReachabilityConfig.pick(records[0].spec.hyperparameters)
    curves = [measured(folder) for folder in folders]
    by_random = search(find_actor("random"), env_id, config)
    by_last = [search(find_actor(folder), env_id, config) for folder in folders]
    for points in curves:
        axes.plot(*zip(*points, strict=True), color=colour, linewidth=0.5, alpha=0.35)
    ends = range(WINDOW, min(SHOWN, records[0].spec.task.budget) + 1, WINDOW // 5)
    means = [np.mean([_recent(points, end) for points in curves]) for end in ends]
    axes.plot(ends, means, color=colour, label=_grid(records[0]), linewidth=1.6)
    axes.axhline(by_random.accuracy, color=colour, linestyle=":", linewidth=1)
    print(row(records, curves, by_random, by_last))


def main(path: str, *roots: str) -> None:
    """Draw a panel for each agent."""
    groups: dict[str, dict[str, list[tuple[RunRecord, Path]]]] = {}
    for root in map(Path, roots):
        for record in find_records(root):
            if measured(record.spec.path(root)):
                agent, _, _ = record.spec.agent.partition("@")
                task = groups.setdefault(agent, {}).setdefault(_grid(record), [])
                task.append((record, record.spec.path(root)))
    figure, panels = pyplot.subplots(1, len(groups), figsize=(9, 3.6), layout="constrained", sharey=True, squeeze=False)
    for axes, (agent, tasks) in zip(panels[0], groups.items(), strict=True):
        for colour, pairs in zip(COLOURS, tasks.values(), strict=False):
            draw(axes, colour, *zip(*pairs, strict=True))
        axes.set(title=agent, xlabel="environment steps", xlim=(0, SHOWN), ylim=(0.45, 1))
        axes.xaxis.set_major_formatter(EngFormatter(sep=""))
        axes.legend(loc="lower right", frameon=False)
    panels[0, 0].set_ylabel("held-out accuracy")
    figure.savefig(path, dpi=110)


if __name__ == "__main__":
    main(*sys.argv[1:])
