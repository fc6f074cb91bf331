"""The tables that can be made of a folder: a suite that misses something is named, and stops no other one."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Final

from sprl_bench.records import RunRecord, RunSpec
from sprl_bench.suggestions import unknown
from sprl_bench.tables.comparable import IncomparableError
from sprl_bench.tables.seed_results import MissingRunsError, table_of
from sprl_bench.tables.table import NO_COUNTS, NONE, REMEDY, Table, lost_tables, tabulate
from sprl_bench.tasks import SUITES

NO_FAULTS: Final[Mapping[str, str]] = MappingProxyType({})


def tabulate_finished(
    records: Iterable[RunRecord],
    *,
    tasks: Sequence[str] | None = None,
    agents: Sequence[str] | None = None,
    planned: Iterable[RunSpec] = (),
    allow_missing: bool = False,
    statuses: Mapping[Path, str] = NONE,
    broken: Mapping[str, str] = NO_FAULTS,
    unreadable: Mapping[str, int] = NO_COUNTS,
) -> tuple[list[Table], list[str]]:
    """Return the tables of the suites of which nothing is missing, and a sentence for each other suite.

    Args:
        records: As for `tabulate`.
        tasks: As for `tabulate`.
        agents: As for `tabulate`.
        planned: As for `tabulate`.
        allow_missing: As for `tabulate`: then all that is missing is noted below the tables.
        statuses: As for `tabulate`.
        broken: By suite, why a run of it cannot be read; such a suite has a table only if runs may be missing.
        unreadable: As for `tabulate`.

    Raises:
        ValueError: A task or an agent is unknown.
    """
    everything, wanted = list(records), list(planned)
    specs = [*wanted, *(record.spec for record in everything)]
    _refuse_unknown("task", tasks, {name for spec in specs for name in _tasks_beside(spec)})
    _refuse_unknown("agent", agents, {spec.agent for spec in specs})
    tables: list[Table] = []
    sentences: list[str] = []
    for name, own in _by_table([spec for spec in specs if _is_wanted(spec, tasks, agents)]).items():
        fault = broken.get(own[0].suite, "")
        if fault and not allow_missing:
            sentences.append(fault)
            continue
        try:
            [table] = tabulate(
                _finished(everything, name, own),
                tasks=None if tasks is None else sorted(set(tasks) & _tasks_beside(own[0])),
                agents=None if agents is None else sorted({spec.agent for spec in own}),
                planned=own,
                allow_missing=allow_missing,
                drop_incomparable=allow_missing,
                statuses=statuses,
                unreadable=unreadable,
            )
        except (MissingRunsError, IncomparableError) as error:
            sentences.append(str(error))
        else:
            tables.append(_noted(table, [fault]))
    if allow_missing and tables:
        tables[-1], sentences = _noted(tables[-1], sentences), []
    return tables, sentences


def _tasks_beside(spec: RunSpec) -> set[str]:
    """Return the names of a run's task and of all tasks of its suite."""
    suite = SUITES.get(spec.suite)
    return {spec.task.name, *(task.name for task in (suite.tasks if suite else ()))}


def _is_wanted(spec: RunSpec, tasks: Sequence[str] | None, agents: Sequence[str] | None) -> bool:
    return (tasks is None or not _tasks_beside(spec).isdisjoint(tasks)) and (agents is None or spec.agent in agents)


def _by_table(specs: Sequence[RunSpec]) -> dict[str, list[RunSpec]]:
    groups: dict[str, list[RunSpec]] = {}
    for spec in specs:
        groups.setdefault(table_of(spec.suite, spec.task.name), []).append(spec)
    return dict(sorted(groups.items()))


def _finished(records: Sequence[RunRecord], name: str, planned: Sequence[RunSpec]) -> list[RunRecord]:
    """Return the records of one table.

    Raises:
        MissingRunsError: None of them is complete.
    """
    own = [record for record in records if table_of(record.spec.suite, record.spec.task.name) == name]
    if not any(record.status == "complete" for record in own):
        raise MissingRunsError(f"{lost_tables([], planned)} {REMEDY}")
    return own


def _noted(table: Table, notes: Sequence[str]) -> Table:
    return table.model_copy(update={"notes": (*table.notes, *(note for note in notes if note))})


def _refuse_unknown(kind: str, chosen: Sequence[str] | None, names: set[str]) -> None:
    for name in chosen or ():
        if name not in names:
            raise ValueError(unknown(f"{kind} among these runs:", name, names))
