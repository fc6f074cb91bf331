"""The content of the page: tables as text, and the data of the charts."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, NamedTuple

from sprl_bench.durations import duration
from sprl_bench.plots.style import Look, looks_of
from sprl_bench.records import RunSpec
from sprl_bench.report.charts import PATTERNS, colour_of, specs_of
from sprl_bench.report.series import (
    SEED_COLUMNS,
    curves_of,
    estimates_of,
    improvements_of,
    metrics_of,
    profiles_of,
    seeds_of,
)
from sprl_bench.report.source import Origin, Progress, Source
from sprl_bench.tables import IncomparableError, Result, Table, split_suites, tabulate_results
from sprl_bench.tables.aggregates import matrices_of
from sprl_bench.tables.render import DASH, explained, footnotes, interval_text, marked
from sprl_bench.tables.seed_results import table_of
from sprl_bench.tables.table import Estimate, Row
from sprl_bench.tables.text_table import number

MEASURES: Final = {
    "auc": "AUC",
    "auc_iqm": "AUC, interquartile mean",
    "final": "Final return",
    "success_auc": "Success, area under its curve",
    "success_final": "Final success",
}


class Agent(NamedTuple):
    """An agent in the page: its look, and whether it sees no more than an ordinary one."""

    name: str
    label: str
    colour: str
    dashes: str
    ordinary: bool


class Number(NamedTuple):
    """A cell: what it says, and what it is sorted by."""

    text: str
    interval: str
    value: float | None
    note: str = ""


class Line(NamedTuple):
    """A row of a table."""

    agent: int
    name: str
    seeds: int
    numbers: tuple[Number, ...]


class Section(NamedTuple):
    """A suite: its table, or why there is none."""

    title: str
    tasks: tuple[str, ...]
    lines: tuple[Line, ...]
    notes: tuple[str, ...]
    problem: str = ""


@dataclass(frozen=True)
class Content:
    """All that the page says; `data` is for its charts, and for downloads."""

    title: str
    agents: tuple[Agent, ...]
    sections: tuple[Section, ...]
    origins: tuple[Origin, ...]
    versions: tuple[tuple[str, str], ...]
    unfinished: tuple[Progress, ...]
    summary: str
    share: float
    notes: tuple[str, ...]
    marks: str
    measures: Mapping[str, str]
    data: dict[str, Any]


def content_of(source: Source) -> Content:
    """Return the content of a source's page."""
    looks = looks_of(_names(source))
    agents = tuple(_agent(name, look, source) for name, look in looks.items())
    groups = split_suites(source.results)
    tables = [_tabulated(group, source) for group in groups]
    sections = [_section(group, table, list(looks)) for group, table in zip(groups, tables, strict=True)]
    return Content(
        title=source.title,
        agents=agents,
        sections=tuple(sections),
        origins=source.origins,
        versions=tuple(_versions(source.origins)),
        unfinished=tuple(one for one in source.progress if one.status != "finished"),
        summary=_summary(source.progress, source.seconds_left),
        share=_share(source.progress),
        notes=(*_lost(source, groups), *source.notes),
        marks="".join(f" {mark}" for mark in _marks(source)),
        measures=MEASURES,
        data={
            "sections": [_chart_data(group, table) for group, table in zip(groups, tables, strict=True)],
            "metrics": metrics_of(source.logged),
            "seed_columns": SEED_COLUMNS,
            "seeds": seeds_of(source.results),
            "specs": specs_of(looks),
        },
    )


def _names(source: Source) -> set[str]:
    """Return the names of all agents, planned ones too."""
    return {one.agent for one in _runs(source)}


def _marks(source: Source) -> list[str]:
    """Return a sentence for each mark that an agent's name bears in charts."""
    return explained((one.privileged, one.information) for one in _runs(source))


def _runs(source: Source) -> Sequence[Result | RunSpec]:
    return [*source.results, *source.planned, *(spec for spec, _ in source.logged)]


def _agent(name: str, look: Look, source: Source) -> Agent:
    known = next(one for one in _runs(source) if one.agent == name)
    return Agent(
        name=name,
        label=marked(name, known.privileged, known.information),
        colour=colour_of(look),
        dashes=" ".join(map(str, PATTERNS[look.dashes])),
        ordinary=not known.privileged and not known.information,
    )


def _tabulated(group: Sequence[Result], source: Source) -> Table | str:
    """Return the table of a suite, or why its results are not comparable."""
    try:
        return tabulate_results(
            group,
            planned=source.planned,
            allow_missing=True,
            statuses={one.spec.path(Path()): one.status for one in source.progress},
            unreadable=source.unreadable,
        )
    except IncomparableError as error:
        return str(error)


def _section(group: Sequence[Result], table: Table | str, agents: Sequence[str]) -> Section:
    title = table_of(group[0].suite, group[0].task.name)
    if isinstance(table, str):
        return Section(title, (), (), (), table)
    rows = sorted(table.rows, key=lambda row: (-row.auc.value if row.auc else 0.0, row.agent))
    lines = tuple(_line(row, agents.index(row.agent)) for row in rows)
    return Section(f"{title}, version {table.suite_version}", table.tasks, lines, tuple(footnotes(table)))


def _line(row: Row, agent: int) -> Line:
    cells = [_number(cell.auc, _missing(len(cell.seeds), len(cell.missing))) for cell in row.cells]
    overall = [_number(value) for value in (row.auc, row.auc_iqm, row.final, row.success_final)]
    name = marked(row.agent, row.privileged, row.information) + " ‡" * (not row.complete)
    return Line(agent, name, len(row.seeds), (*overall, *cells))


def _missing(there: int, missing: int) -> str:
    return f"{there} of {there + missing} seeds" if missing else ""


def _number(value: Estimate | None, note: str = "") -> Number:
    if value is None:
        return Number(DASH, "", None, note)
    return Number(number(value.value), interval_text(value.interval), value.value, note)


def _chart_data(group: Sequence[Result], table: Table | str) -> dict[str, Any]:
    """Return what the charts of a suite show; nothing where its results are not comparable."""
    if isinstance(table, str):
        return {"tasks": [], "estimates": [], "curves": [], "improvements": [], "profiles": []}
    matrices = matrices_of(group, table)
    return {
        "suite": table.suite,
        "tasks": [_task(name, group) for name in table.tasks],
        "estimates": estimates_of(table),
        "curves": curves_of(group, table.tasks),
        "improvements": improvements_of(matrices),
        "profiles": profiles_of(matrices),
    }


def _task(name: str, group: Sequence[Result]) -> dict[str, Any]:
    """Return a task's name, budget, and the range of its axis: of its scores, widened to the returns."""
    runs = [result for result in group if result.task.name == name]
    values = [value for run in runs for value in (*run.task.score_range, min(run.return_curve), max(run.return_curve))]
    return {
        "name": name,
        "budget": runs[0].task.budget if runs else 0,
        "range": [min(values), max(values)] if runs else [0, 1],
    }


def _lost(source: Source, groups: Sequence[Sequence[Result]]) -> Iterable[str]:
    """Name the suites of which no run is finished."""
    there = {table_of(group[0].suite, group[0].task.name) for group in groups}
    lost = sorted({table_of(spec.suite, spec.task.name) for spec in source.planned} - there)
    if lost:
        yield f"No run is finished of {', '.join(lost)}."


def _summary(progress: Sequence[Progress], seconds_left: float | None) -> str:
    """Return how many runs have which status, and how long all of them take if some go on."""
    if not progress:
        return ""
    statuses = [one.status for one in progress]
    counts = [f"{statuses.count(name)} {name}" for name in dict.fromkeys(sorted(statuses))]
    left = f" {duration(seconds_left)} left." if {"running", "waiting"} & set(statuses) else ""
    return f"{len(progress)} run{'s' * (len(progress) > 1)}: {', '.join(counts)}.{left}"


def _share(progress: Sequence[Progress]) -> float:
    """Return the share of all env steps that are taken."""
    budget = sum(one.spec.task.budget for one in progress)
    return sum(min(one.env_steps, one.spec.task.budget) for one in progress) / budget if budget else 1.0


def _versions(origins: Sequence[Origin]) -> Iterable[tuple[str, str]]:
    """Yield each package with its version, or with its versions and who used them."""
    for package in sorted({name for origin in origins for name in origin.versions}):
        found: dict[str, list[str]] = {}
        for origin in origins:
            if package in origin.versions:
                found.setdefault(origin.versions[package], []).append(origin.agent)
        texts = [f"{version} ({', '.join(sorted(set(agents)))})" for version, agents in sorted(found.items())]
        yield package, next(iter(found)) if len(found) == 1 else "; ".join(texts)
