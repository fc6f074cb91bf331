"""Draw how well the reachability network learns: `python docs/draw_accuracy.py RUNS docs/accuracy.png`.

RUNS are made by `sprl-bench run --suite grid --agents sprl --budget 400000 --seeds 50, --set learning_rate=0.003 --set
cost_scale=0.01 --out RUNS`. The figures of each task are printed as the rows of a table.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import matplotlib as mpl

from sprl_bench.records import find_records

mpl.use("Agg")
from matplotlib import pyplot

BAR = 0.8
AT = (100_000, 200_000, 300_000, 400_000)  # env steps of the printed figures, each the mean of the 50 000 before it
WINDOW = 50_000

Points = list[tuple[int, float]]


def measured(run: Path) -> Points:
    """Return the env steps and the accuracy of every measurement of a run."""
    lines = map(json.loads, (run / "metrics.jsonl").read_text().splitlines())
    return [(line["env_steps"], line["reachability_accuracy"]) for line in lines if "reachability_accuracy" in line]


def row(task: str, points: Points) -> str:
    """Return a row of a table: when the bar was first passed, and means at some steps."""
    first = next(f"{steps:,}" for steps, accuracy in points if accuracy > BAR)
    cells = []
    for end in AT:
        recent = [accuracy for steps, accuracy in points if end - WINDOW < steps <= end]
        cells.append(f"{sum(recent) / len(recent):.3f}")
    return f"| {task} | {first} | " + " | ".join(cells) + " |"


def main(root: str, path: str) -> None:
    """Draw one curve a task."""
    figure, panel = pyplot.subplots(figsize=(7, 3.6), layout="constrained")
    for record in find_records(Path(root)):
        task = record.spec.task.name.rpartition("-")[0]
        points = measured(record.spec.path(Path(root)))
        panel.plot(*zip(*points, strict=True), label=task, linewidth=1.4)
        print(row(task, points))
    panel.axhline(BAR, color="0.5", linestyle=":", linewidth=1)
    panel.set(xlabel="environment steps", ylabel="held-out accuracy", ylim=(0.45, 1))
    panel.legend(loc="lower right", frameon=False)
    figure.savefig(path, dpi=110)


if __name__ == "__main__":
    main(*sys.argv[1:3])
