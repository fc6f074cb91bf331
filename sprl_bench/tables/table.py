"""A table as a value: one row an agent, one cell a task, every mean with its interval and its number of seeds.

Each interval has its own generator with a fixed seed: the same runs give the same table byte for byte, and one agent's
row does not depend on another's.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from pydantic import Field

from sprl_bench import scores
from sprl_bench.extras import require_extra
from sprl_bench.records import Data, RunRecord, RunSpec, Scores
from sprl_bench.suggestions import unknown
from sprl_bench.tables.comparable import check_comparable, split_comparable
from sprl_bench.tables.drops import Drop, drops_of, unfinished_text
from sprl_bench.tables.seed_results import (
    Hole,
    MissingRunsError,
    Result,
    describe_holes,
    find_holes,
    split_suites,
    table_of,
    task_names,
)

if TYPE_CHECKING:  # the extra `plots`
    from pandas import DataFrame

MEASURES = ("auc", "final", "success_auc", "success_final")
BOOTSTRAP_SEED = 20210706
"""Seeds the generator of every interval."""
NONE: Final[Mapping[Path, str]] = MappingProxyType({})
NO_COUNTS: Final[Mapping[str, int]] = MappingProxyType({})
REMEDY = (
    "Finish them with the command that began them, allow missing runs (--allow-missing) to see the others, or choose "
    "with --suite, --task or --agent; remove the folders only of runs that you do not want."
)


class Estimate(Data):
    """A number with its 95 % stratified-bootstrap interval, which is None for a single seed."""

    value: float
    interval: scores.Interval | None
    seeds: int
    values: tuple[tuple[float, ...], ...] = Field(default=(), exclude=True)  # [S, T], what it is the statistic of


class Cell(Data):
    """One agent on one task, over its finished seeds."""

    task: str
    seeds: tuple[int, ...]
    missing: tuple[int, ...]
    auc: Estimate | None
    final: Estimate | None
    success_auc: Estimate | None
    success_final: Estimate | None
    steps_to_threshold: tuple[int | None, ...]
    trend: tuple[float, ...] = Field(
        default=(), exclude=True
    )  # of the mean curve, a share of the score range an eighth


class Row(Data):
    """One agent; its overall numbers are over the seeds that it has on every task."""

    agent: str
    privileged: bool
    information: tuple[str, ...] = ()
    seeds: tuple[int, ...]
    cells: tuple[Cell, ...]
    auc: Estimate | None
    auc_iqm: Estimate | None
    final: Estimate | None
    success_auc: Estimate | None
    success_final: Estimate | None

    @property
    def complete(self) -> bool:
        """Whether no run is missing."""
        return not any(cell.missing for cell in self.cells)


class Table(Data):
    """The agents of one suite."""

    suite: str
    suite_version: int
    tasks: tuple[str, ...]
    rows: tuple[Row, ...]
    notes: tuple[str, ...]
    planned: int = Field(description="How many runs there should be: agents x tasks x seeds.")
    drops: tuple[Drop, ...] = ()
    unreadable: int = Field(default=0, description="How many runs of the suite cannot be read.")

    def to_frame(self) -> DataFrame:
        """Return the numbers as a pandas data frame, one row a number.

        It is indexed by `agent`, `task` and `measure`; the task "all" is the whole suite. Columns: `value`, `low` and
        `high` (the 95 % interval, missing for a single seed), `seeds` and `privileged`. A missing number has no row.

        Raises:
            ModuleNotFoundError: pandas, of the extra `plots`, is not installed.
        """
        frame: DataFrame = require_extra("pandas").DataFrame([line for row in self.rows for line in _frame_rows(row)])
        texts = dict.fromkeys(("agent", "task", "measure"), "string[python]")
        return frame.astype({**texts, "low": "float64", "high": "float64"}).set_index([*texts])


def _frame_rows(row: Row) -> Iterator[dict[str, Any]]:
    cells = [(cell.task, name, getattr(cell, name)) for cell in row.cells for name in MEASURES]
    overall = [("all", name, getattr(row, name)) for name in (*MEASURES, "auc_iqm")]
    for task, measure, estimate in (*cells, *overall):
        if estimate is not None:
            low, high = estimate.interval or (None, None)
            yield {
                "agent": row.agent,
                "task": task,
                "measure": measure,
                "value": estimate.value,
                "low": low,
                "high": high,
                "seeds": estimate.seeds,
                "privileged": row.privileged,
            }


def tabulate(
    records: Iterable[RunRecord],
    *,
    tasks: Sequence[str] | None = None,
    agents: Sequence[str] | None = None,
    planned: Iterable[RunSpec] = (),
    allow_missing: bool = False,
    drop_incomparable: bool = False,
    statuses: Mapping[Path, str] = NONE,
    unreadable: Mapping[str, int] = NO_COUNTS,
) -> list[Table]:
    """Return one table for each suite among these records.

    Args:
        records: Finished runs; incomplete ones count as missing.
        tasks: The tasks to show, or None for all tasks of each suite.
        agents: The agents to show, or None for all.
        planned: Specs of all runs that there should be: those without a record count as missing.
        allow_missing: Show and mark the finished runs where others are missing.
        drop_incomparable: Leave out the runs of another environment, budget or suite version than most have, and name
            them, instead of refusing the table.
        statuses: Why planned runs are unfinished, such as "failed", by their path below the folder of all runs.
        unreadable: By suite, how many runs cannot be read, whatever was planned there.

    Raises:
        MissingRunsError: Runs are missing and `allow_missing` is false.
        IncomparableError: The records must not share a table.
        ValueError: There is no finished run, or a task or an agent is unknown.
    """
    everything, planned = _of_agents(list(records), list(planned), agents)
    complete = [Result.of(record) for record in everything if record.status == "complete"]
    stopped = [record.spec for record in everything if record.status != "complete"]
    wanted = [*planned, *stopped]
    statuses = {**{spec.path(Path()): "interrupted" for spec in stopped}, **statuses}
    if not complete:
        raise MissingRunsError("There is no finished run to make a table of.")
    groups = split_suites(complete)
    names = {name for group in groups for name in task_names(group)}
    for task in tasks or ():
        if task not in names:
            raise ValueError(unknown("task among these runs:", task, names))
    chosen = names if tasks is None else set(tasks)
    lost = lost_tables(complete, [spec for spec in wanted if tasks is None or spec.task.name in chosen])
    if lost and not allow_missing:
        raise MissingRunsError(f"{lost} {REMEDY}")
    tables = [
        tabulate_results(
            group,
            tasks=chosen,
            planned=wanted,
            allow_missing=allow_missing,
            drop_incomparable=drop_incomparable,
            statuses=statuses,
            unreadable=unreadable,
        )
        for group in groups
        if chosen & set(task_names(group))
    ]
    if lost:
        tables[-1] = tables[-1].model_copy(update={"notes": (*tables[-1].notes, lost)})
    return tables


def select_results(
    records: Iterable[RunRecord], *, tasks: Sequence[str] | None = None, agents: Sequence[str] | None = None
) -> list[Result]:
    """Return the finished runs of some tasks and agents, which may share a table or a picture.

    Raises:
        MissingRunsError: There is no finished run.
        IncomparableError: They must not be compared.
        ValueError: A task or an agent is unknown.
    """
    everything, _ = _of_agents(list(records), [], agents)
    complete = [Result.of(record) for record in everything if record.status == "complete"]
    names = {result.task.name for result in complete}
    for task in tasks or ():
        if task not in names:
            raise ValueError(unknown("task among these runs:", task, names))
    chosen = [result for result in complete if tasks is None or result.task.name in tasks]
    if not chosen:
        raise MissingRunsError("There is no finished run among these.")
    for group in split_suites(chosen):
        check_comparable(group)
    return chosen


def _of_agents(
    records: list[RunRecord], planned: list[RunSpec], agents: Sequence[str] | None
) -> tuple[list[RunRecord], list[RunSpec]]:
    """Return the records and the plans of these agents; None stands for all."""
    if agents is None:
        return records, planned
    names = {spec.agent for spec in (*planned, *(record.spec for record in records))}
    for agent in agents:
        if agent not in names:
            raise ValueError(unknown("agent among these runs:", agent, names))
    own = [record for record in records if record.spec.agent in agents]
    return own, [spec for spec in planned if spec.agent in agents]


def lost_tables(results: Sequence[Result], wanted: Iterable[RunSpec]) -> str:
    """Say which tables are left out because none of their runs is finished; empty if there are none."""
    there = {table_of(result.suite, result.task.name) for result in results}
    lost = [spec for spec in wanted if table_of(spec.suite, spec.task.name) not in there]
    if not lost:
        return ""
    names = sorted({table_of(spec.suite, spec.task.name) for spec in lost})
    holes = sorted({Hole(spec.agent, spec.task.name, spec.seed) for spec in lost}, key=str)
    return f"No run is finished of {', '.join(names)}; {describe_holes(holes)}."


def tabulate_results(
    results: Sequence[Result],
    *,
    tasks: Collection[str] | None = None,
    planned: Iterable[RunSpec] = (),
    allow_missing: bool = False,
    drop_incomparable: bool = False,
    statuses: Mapping[Path, str] = NONE,
    unreadable: Mapping[str, int] = NO_COUNTS,
) -> Table:
    """Return the table of one suite's results; see `tabulate`."""
    names = tuple(name for name in task_names(results) if tasks is None or name in tasks)
    shown = [result for result in results if result.task.name in names]
    if not shown:
        raise MissingRunsError(f"Suite {results[0].suite!r} has no finished run of {', '.join(names)}.")
    shown, incomparable = split_comparable(shown) if drop_incomparable else (shown, [])
    notes = check_comparable(shown)
    wanted = list(planned)
    holes = find_holes(shown, wanted, names)
    unusable = [Hole(one.agent, one.task.name, one.seed) for one in incomparable]
    drops = drops_of(results[0].suite, holes, unusable, statuses)
    if holes and not allow_missing:
        raise MissingRunsError(f"Suite {results[0].suite!r}: {describe_holes(holes)}{unfinished_text(drops)}. {REMEDY}")
    by_agent: dict[str, list[Result]] = {hole.agent: [] for hole in holes}
    for result in shown:
        by_agent.setdefault(result.agent, []).append(result)
    known: dict[str, tuple[bool, tuple[str, ...]]] = {}
    known |= {spec.agent: (spec.privileged, spec.information) for spec in wanted}
    known |= {result.agent: (result.privileged, result.information) for result in shown}
    return Table(
        suite=shown[0].suite,
        suite_version=shown[0].suite_version,
        tasks=names,
        rows=tuple(
            sorted((_row(agent, known[agent], runs, names, holes) for agent, runs in by_agent.items()), key=_place)
        ),
        notes=(*([describe_holes(holes) + "."] if holes else []), *notes),
        planned=len(shown) + len({*holes, *unusable}),
        drops=drops,
        unreadable=unreadable.get(shown[0].suite, 0),
    )


def _place(row: Row) -> tuple[float, str]:
    """Return where a row stands: the highest mean AUC first, then those without one, by name."""
    return (-row.auc.value if row.auc else math.inf, row.agent)


def _row(
    agent: str,
    marks: tuple[bool, tuple[str, ...]],
    results: Sequence[Result],
    tasks: Sequence[str],
    holes: Sequence[Hole],
) -> Row:
    of_tasks = {task: [result for result in results if result.task.name == task] for task in tasks}
    by_task = {task: {result.seed: result.scores for result in of_task} for task, of_task in of_tasks.items()}
    seeds = tuple(sorted(set.intersection(*(set(of_task) for of_task in by_task.values()))))
    cells = [
        _cell(task, of_task, tuple(hole.seed for hole in holes if (hole.agent, hole.task) == (agent, task)))
        for task, of_task in of_tasks.items()
    ]
    complete = {task: {seed: of_task[seed] for seed in seeds} for task, of_task in by_task.items()}
    iqm = estimate(complete, "auc", scores.iqm)
    return Row(
        agent=agent,
        privileged=marks[0],
        information=marks[1],
        seeds=seeds,
        cells=tuple(cells),
        auc_iqm=iqm,
        **_estimates(complete),
    )


def _cell(task: str, results: Sequence[Result], missing: tuple[int, ...]) -> Cell:
    column = {task: dict(sorted((result.seed, result.scores) for result in results))}
    return Cell(
        task=task,
        seeds=tuple(column[task]),
        missing=missing,
        steps_to_threshold=tuple(score.steps_to_threshold for score in column[task].values()),
        trend=_trend(results),
        **_estimates(column),
    )


def _trend(results: Sequence[Result]) -> tuple[float, ...]:
    """Return the mean curve in eight values, each as a share of the task's score range; nothing without a result."""
    if not results:
        return ()
    low, high = results[0].task.score_range
    curve = np.mean([result.return_curve for result in results], axis=0)
    return tuple(float((part.mean() - low) / (high - low)) for part in np.array_split(curve, 8))


def matrix(by_task: Mapping[str, Mapping[int, Scores]], name: str) -> scores.Array:
    """Return one score of every run: [S, T], seeds ascending, tasks in the given order."""
    columns = [[getattr(of_task[seed], name) for seed in sorted(of_task)] for of_task in by_task.values()]
    return np.asarray(columns, dtype=np.float64).T


def _estimates(by_task: Mapping[str, Mapping[int, Scores]]) -> dict[str, Any]:
    return {name: estimate(by_task, name) for name in MEASURES}


def estimate(
    by_task: Mapping[str, Mapping[int, Scores]], name: str, statistic: scores.Statistic = scores.mean
) -> Estimate | None:
    """Return a statistic of one score with its interval, or None without a seed.

    Args:
        by_task: Scores by task and seed, the same seeds for every task.
        name: A field of `Scores`.
        statistic: From [..., S, T] to [...].
    """
    values = matrix(by_task, name)
    if values.size == 0:
        return None
    return Estimate(
        value=float(statistic(values)),
        interval=scores.bootstrap_interval(values, statistic, np.random.default_rng(BOOTSTRAP_SEED)),
        seeds=values.shape[0],
        values=tuple(map(tuple, values.tolist())),
    )
