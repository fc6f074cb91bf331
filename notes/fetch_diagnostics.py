"""What happened inside the runs of the board `fetch-sparse`, a row a run: `python notes/fetch_diagnostics.py RUNS`.

Adds the finished runs of a folder to notes/fetch-diagnostics.csv: entries keep curves, but not the diagnostics.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import pandas as pd

from sprl_bench.records import RunRecord, find_records

TABLE = Path(__file__).with_name("fetch-diagnostics.csv")
KEYS = ["task", "agent", "seed"]
LAST = 0.1  # of the budget
"""The share of a run over which its last values are means."""


def main() -> None:
    """Add the runs of the folder to the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("runs", type=Path, help="a folder with runs of the suite fetch-sparse")
    runs = parser.parse_args().runs
    found = [
        row_of(record, pd.read_json(record.spec.path(runs) / "metrics.jsonl", lines=True))
        for record in find_records(runs)
        if record.status == "complete" and record.spec.suite == "fetch-sparse"
    ]
    known = [pd.read_csv(TABLE)] if TABLE.exists() else []
    table = pd.concat([*known, pd.DataFrame(found)]).drop_duplicates(KEYS, keep="last").sort_values(KEYS)
    table.to_csv(TABLE, index=False, float_format="%.6g")


def row_of(record: RunRecord, metrics: pd.DataFrame) -> dict[str, object]:
    """Return a run's diagnostics; what an agent does not have is missing."""
    spec = record.spec
    last = metrics[metrics.env_steps > (1 - LAST) * spec.task.budget]
    row: dict[str, object] = {
        "task": spec.task.name,
        "agent": spec.agent,
        "seed": spec.seed,
        "auc": record.scores.auc,
        "final": record.scores.final,
        "wall_time_s": record.wall_time_s,
    }
    if "bonus" in metrics:
        row |= {"bonus_a_step": metrics.bonus.mean(), "last_bonus_a_step": last.bonus.mean()}
        row |= {"last_reward_deviation": last.reward_deviation.mean()}
    if "violations" in metrics:
        row |= {"violations": metrics.violations.mean(), "last_violations": last.violations.mean()}
    if "reachability_accuracy" in metrics:
        accuracy = metrics.set_index("env_steps").reachability_accuracy.dropna()
        trusted_at = metrics[metrics.reachability_ready == 1].env_steps.min()
        before = accuracy[accuracy.index <= trusted_at]
        row |= {
            "trusted_at": trusted_at,
            "accuracy_when_trusted": before.iloc[-1] if len(before) else None,
            "last_accuracy": accuracy.iloc[-1],
        }
    return row


if __name__ == "__main__":
    main()
