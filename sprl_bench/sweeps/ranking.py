"""Which setting is best, by the declared rule, and how sure that is."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from sprl_bench import scores
from sprl_bench.naming import AgentName
from sprl_bench.records import RunRecord
from sprl_bench.sweeps.declaration import Declaration, Setting
from sprl_bench.sweeps.sensitivity import Sensitivity, sensitivity
from sprl_bench.tables import BOOTSTRAP_SEED, Result, check_comparable
from sprl_bench.tasks import find_suite, with_budget


@dataclass(frozen=True)
class Ranked:
    """One setting and its scores.

    Attributes:
        setting: The setting.
        aucs: [S, T], NaN for a run that is missing.
        mean: Over the tasks of the mean over the seeds; None where a task has no run.
        interval: 95 %, of the mean; None for a single seed or where a run is missing.
    """

    setting: Setting
    aucs: scores.Array
    mean: float | None
    interval: scores.Interval | None

    @property
    def complete(self) -> bool:
        """Whether no run is missing."""
        return not np.isnan(self.aucs).any()

    @property
    def by_task(self) -> scores.Array:
        """The mean over the finished seeds of each task, [T]."""
        return np.asarray(np.nanmean(self.aucs, axis=0))


@dataclass(frozen=True)
class Ranking:
    """All settings of one agent, the best first.

    Attributes:
        agent: The agent.
        tasks: The columns of the scores.
        seeds: The rows of a setting's scores.
        settings: Those with at least one run on each task: first those without a missing run; by their mean, then in
            the order of the declaration.
        missing: How many runs are missing.
    """

    agent: str
    tasks: tuple[str, ...]
    seeds: tuple[int, ...]
    settings: tuple[Ranked, ...]
    missing: int

    @property
    def chosen(self) -> Ranked | None:
        """The setting by the declared rule; None while a run is missing."""
        return None if self.missing else self.settings[0]

    @property
    def ties(self) -> int:
        """How many other settings have the mean of the first one exactly."""
        return sum(one.mean == self.settings[0].mean for one in self.settings[1:])

    @property
    def scores(self) -> scores.Array:
        """The mean AUC of each setting on each task, [H, T]."""
        return np.array([ranked.by_task for ranked in self.settings])

    @property
    def values(self) -> list[Mapping[str, Any]]:
        """The hyperparameters of each setting."""
        return [ranked.setting.values for ranked in self.settings]

    @property
    def sensitivity(self) -> Sensitivity | None:
        """How much the agent depends on tuning; None while a run is missing."""
        return None if self.missing else sensitivity(self.scores, self.values)


def rank(declaration: Declaration, records: Iterable[RunRecord]) -> list[Ranking]:
    """Return the ranking of each agent's settings, in the order of the declaration.

    The order of the records does not matter, nor do records of other runs.

    Raises:
        IncomparableError: The runs are not comparable.
    """
    tasks = {_run_name(name, budget, declaration): name for name, budget in declaration.tasks.items()}
    found: dict[str, dict[tuple[int, str], Result]] = {}
    for record in sorted(records, key=lambda one: (one.spec.task.name, one.spec.agent, one.spec.seed)):
        if record.status == "complete" and record.spec.task.name in tasks and record.spec.seed in declaration.seeds:
            its = found.setdefault(record.spec.agent, {})
            its[record.spec.seed, tasks[record.spec.task.name]] = Result.of(record)
    for task in declaration.tasks:
        if of_task := [result for its in found.values() for (_, name), result in its.items() if name == task]:
            check_comparable(of_task)
    return [_ranking(agent, settings, declaration, found) for agent, settings in declaration.settings.items()]


def _run_name(task: str, budget: int, declaration: Declaration) -> str:
    """Return the name of a task under its budget, as the plan names it."""
    row = find_suite(declaration.suite).task(task)
    return task if budget == row.budget else with_budget(row, budget).name


def _ranking(
    agent: str,
    settings: Iterable[Setting],
    declaration: Declaration,
    found: Mapping[str, Mapping[tuple[int, str], Result]],
) -> Ranking:
    ranked, missing = [], 0
    for setting in settings:
        its = found.get(str(AgentName.parse(setting.name)), {})
        aucs = np.array(
            [
                [its[seed, task].scores.auc if (seed, task) in its else np.nan for task in declaration.tasks]
                for seed in declaration.seeds
            ]
        )
        missing += int(np.isnan(aucs).sum())
        if not np.isnan(aucs).all(axis=0).any():
            ranked.append(_ranked(setting, aucs))
    ranked.sort(key=lambda one: (one.complete, one.mean or 0.0), reverse=True)  # stable: equal ones stay as declared
    return Ranking(agent, tuple(declaration.tasks), declaration.seeds, tuple(ranked), missing)


def _ranked(setting: Setting, aucs: scores.Array) -> Ranked:
    whole = not np.isnan(aucs).any()
    generator = np.random.default_rng(BOOTSTRAP_SEED)
    interval = scores.bootstrap_interval(aucs, scores.mean, generator) if whole else None
    return Ranked(setting, aucs, float(np.nanmean(aucs, axis=0).mean()), interval)
