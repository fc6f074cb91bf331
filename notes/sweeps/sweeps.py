"""Sweeps: settings that are declared, run through the harness, and compared by mean AUC."""

from __future__ import annotations

import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sprl_bench.executors import make_executor
from sprl_bench.progress import make_observer
from sprl_bench.records import find_records
from sprl_bench.suite import expand, run_suite
from sprl_bench.tasks import find_suite

Setting = Mapping[str, Any]


@dataclass(frozen=True)
class Sweep:
    """What is run for one agent: every setting, on every task, with every seed.

    The mean over tasks of the mean AUC over seeds decides.
    """

    agent: str
    settings: Sequence[Setting]
    suite: str
    budgets: Mapping[str, int]  # env steps by task
    seeds: Sequence[int]

    def run(self, root: Path, workers: int) -> None:
        """Train with all settings, and leave the records under `root`; resumes where it stopped.

        Raises:
            RuntimeError: A run failed.
        """
        for setting in self.settings:
            specs = [
                spec
                for task, budget in self.budgets.items()
                for spec in expand(
                    find_suite(self.suite), [self.agent], self.seeds, tasks=[task], budget=budget, overrides=setting
                )
            ]
            outcomes = run_suite(
                specs, self._folder(root, setting), executor=make_executor("local", workers), observer=make_observer()
            )
            for outcome in outcomes:
                if outcome.status == "failed":
                    raise RuntimeError(f"{outcome.spec.path(self._folder(root, setting))}: {outcome.error}")

    def report(self, root: Path) -> str:
        """Return a line for every setting, the best first: the AUC of each task and seed, and their mean.

        Raises:
            ValueError: A run is missing.
        """
        rows = sorted((self._aucs(root, setting) for setting in self.settings), key=_mean, reverse=True)
        return "\n".join(self._line(row) for row in rows)

    def _folder(self, root: Path, setting: Setting) -> Path:
        return root / self.agent / _name(setting)

    def _aucs(self, root: Path, setting: Setting) -> tuple[str, list[list[float]]]:
        folder = self._folder(root, setting)
        complete = [record for record in find_records(folder) if record.status == "complete"]
        of_tasks = [[r.scores.auc for r in complete if r.spec.task.name.startswith(task)] for task in self.budgets]
        if any(len(aucs) != len(self.seeds) for aucs in of_tasks):
            raise ValueError(f"{folder} has {len(complete)} of {len(self.seeds) * len(self.budgets)} runs.")
        return _name(setting), of_tasks

    def _line(self, row: tuple[str, list[list[float]]]) -> str:
        name, of_tasks = row
        figures = "  ".join(
            f"{task} " + " ".join(f"{auc:.3f}" for auc in aucs)
            for task, aucs in zip(self.budgets, of_tasks, strict=True)
        )
        return f"{self.agent:8} {name:60} {figures}  mean {_mean(row):.3f}"


def _name(setting: Setting) -> str:
    return ",".join(f"{key}={value}" for key, value in setting.items())


def _mean(row: tuple[str, list[list[float]]]) -> float:
    return statistics.mean(statistics.mean(aucs) for aucs in row[1])
