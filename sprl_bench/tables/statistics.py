"""Other statistics of the runs in a table: which seeds solved the task, when they first did, how near the oracle.

A table of a statistic shows the runs of an ordinary table: the same rows, tasks, notes and drops.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType
from typing import Final

import numpy as np

from sprl_bench import scores
from sprl_bench.outcomes import SOLVED, first_goal, median_time, wilson_interval
from sprl_bench.records import Data
from sprl_bench.suggestions import unknown
from sprl_bench.tables.drops import Drop
from sprl_bench.tables.seed_results import Result
from sprl_bench.tables.table import BOOTSTRAP_SEED, Table
from sprl_bench.tasks import ORACLES


class StatisticCell(Data):
    """One statistic of one agent on one task.

    Attributes:
        task: Its name, or "all".
        value: None where it is unknown, such as a median that is censored.
        low: Lower end of the 95 % interval; None where it is unknown or beyond the budget.
        high: Upper end of the 95 % interval; None likewise.
        count: How many seeds solved the task or reached the goal; all seeds for an AUC.
        seeds: How many seeds there are.
    """

    task: str
    value: float | None
    low: float | None
    high: float | None
    count: int
    seeds: int


class StatisticRow(Data):
    """One statistic of one agent."""

    agent: str
    privileged: bool
    information: tuple[str, ...] = ()
    cells: tuple[StatisticCell, ...]


class StatisticTable(Data):
    """One statistic of the agents of one suite."""

    statistic: str
    suite: str
    suite_version: int
    columns: tuple[str, ...]
    rows: tuple[StatisticRow, ...]
    notes: tuple[str, ...]
    planned: int
    drops: tuple[Drop, ...] = ()
    unreadable: int = 0


Of = Callable[[str, Sequence[Result]], StatisticCell]


def _solved(task: str, runs: Sequence[Result]) -> StatisticCell:
    count = sum(run.scores.success_final >= SOLVED for run in runs)
    return _cell(task, count / len(runs), wilson_interval(count, len(runs)), count, len(runs))


def _first_goal(task: str, runs: Sequence[Result]) -> StatisticCell:
    budget = runs[0].task.budget
    found = median_time([first_goal(run.success_curve, budget) for run in runs], budget)
    return _cell(task, found.median, (found.low, found.high), found.reached, found.total)


def _oracle(task: str, runs: Sequence[Result]) -> StatisticCell:
    if runs[0].task.env_id not in ORACLES:
        return _cell(task, None, (None, None), len(runs), len(runs))
    shares = np.array([[_of_oracle(run)] for run in runs])
    interval = scores.bootstrap_interval(shares, scores.mean, np.random.default_rng(BOOTSTRAP_SEED))
    return _cell(task, float(shares.mean()), interval or (None, None), len(runs), len(runs))


def _of_oracle(run: Result) -> float:
    """Return the AUC on a scale on which 0 is 0 and the solver's mean return is 1."""
    return float(scores.normalized(run.scores.auc, (0.0, ORACLES[run.task.env_id])))


def _cell(
    task: str, value: float | None, ends: tuple[float | None, float | None], count: int, seeds: int
) -> StatisticCell:
    return StatisticCell(task=task, value=value, low=ends[0], high=ends[1], count=count, seeds=seeds)


STATISTICS: Final[Mapping[str, Of]] = MappingProxyType(
    {"first-goal": _first_goal, "oracle": _oracle, "solved": _solved}
)
EXPLAINED: Final = MappingProxyType(
    {
        "first-goal": "Env steps until the first bin with a success ends: the Kaplan-Meier median, its 95 % interval, "
        "and how many seeds reached the goal. A dash: later than the budget.",
        "oracle": "AUC divided by the solver's mean return, with 95 % stratified-bootstrap intervals. A dash: the task "
        "has no solver.",
        "solved": "Share of seeds whose success is at least 50 % over the last tenth of the budget, with Wilson's 95 % "
        "interval.",
    }
)


def tabulate_statistic(tables: Sequence[Table], results: Sequence[Result], statistic: str) -> list[StatisticTable]:
    """Return a table of one statistic for each ordinary table.

    Args:
        tables: Of these results; they decide which runs are comparable.
        results: Of finished runs.
        statistic: One of `STATISTICS`.

    Raises:
        ValueError: There is no such statistic.
    """
    if statistic not in STATISTICS:
        raise ValueError(unknown("statistic", statistic, ("auc", *STATISTICS)))
    return [_table(table, results, statistic) for table in tables]


def _table(table: Table, results: Sequence[Result], statistic: str) -> StatisticTable:
    found = {(one.agent, one.task.name, one.seed): one for one in results if one.suite == table.suite}
    rows = []
    for row in table.rows:
        runs = {cell.task: [found[row.agent, cell.task, seed] for seed in cell.seeds] for cell in row.cells}
        cells = tuple(_of(statistic, task, of_task) for task, of_task in runs.items())
        rows.append(StatisticRow(agent=row.agent, privileged=row.privileged, information=row.information, cells=cells))
    return StatisticTable(
        statistic=statistic,
        suite=table.suite,
        suite_version=table.suite_version,
        columns=table.tasks,
        rows=tuple(rows),
        notes=table.notes,
        planned=table.planned,
        drops=table.drops,
        unreadable=table.unreadable,
    )


def _of(statistic: str, task: str, runs: Sequence[Result]) -> StatisticCell:
    return STATISTICS[statistic](task, runs) if runs else _cell(task, None, (None, None), 0, 0)
