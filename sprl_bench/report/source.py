"""What a report is made of: results, the runs that there should be, what they logged, and how they were made."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from sprl_bench.leaderboard import Entry, side_by_side
from sprl_bench.records import Hardware, RunRecord, RunSpec
from sprl_bench.tables import Result
from sprl_bench.tables.table import NO_COUNTS

Logged = tuple[RunSpec, Sequence[Mapping[str, Any]]]


class Progress(NamedTuple):
    """How far a run is.

    Attributes:
        spec: Which run.
        status: "finished", "running", "interrupted", "failed" or "waiting".
        env_steps: Taken so far.
        seconds_left: At the present speed; None if unknown.
        error: The last line of its traceback; empty where there is none.
    """

    spec: RunSpec
    status: str
    env_steps: int
    seconds_left: float | None = None
    error: str = ""


@dataclass(frozen=True)
class Origin:
    """How one agent's results on one suite were made; None where that is not known.

    Attributes:
        cost: Seconds of wall time, summed over the runs.
        memory: MiB of the largest run.
        env_steps: Summed over the runs.
        settings: Hyperparameters by task.
        about: The status, authors and link of an entry; empty for runs.
    """

    suite: str
    agent: str
    runs: int
    cost: float | None
    memory: float | None
    env_steps: int
    devices: tuple[str, ...]
    hardware: tuple[str, ...]
    commits: tuple[str, ...]
    versions: Mapping[str, str]
    settings: Mapping[str, Mapping[str, Any]]
    about: str = ""


@dataclass(frozen=True)
class Source:
    """All that a report shows.

    Attributes:
        title: The name of the folder or board.
        results: Of finished runs and of entries.
        planned: The spec of every run that there should be.
        origins: One for each agent and suite.
        logged: Diagnostics of some runs.
        progress: Of the runs in the folder; empty for a board.
        seconds_left: Until all of them are finished, at the present speed; None if unknown.
        notes: Sentences for the reader.
        unreadable: By suite, how many runs cannot be read.
    """

    title: str
    results: tuple[Result, ...]
    planned: tuple[RunSpec, ...] = ()
    origins: tuple[Origin, ...] = ()
    logged: tuple[Logged, ...] = ()
    progress: tuple[Progress, ...] = ()
    seconds_left: float | None = None
    notes: tuple[str, ...] = ()
    unreadable: Mapping[str, int] = field(default_factory=lambda: NO_COUNTS)


def of_board(title: str, entries: Sequence[Entry]) -> Source:
    """Return what a board's report is made of.

    Raises:
        ValueError: The board has no entry.
    """
    results, _ = side_by_side(entries)
    return Source(title=title, results=tuple(results), origins=tuple(map(_origin_of_entry, entries)))


def of_runs(
    title: str,
    records: Sequence[RunRecord],
    progress: Sequence[Progress],
    *,
    seconds_left: float | None = None,
    logged: Sequence[Logged] = (),
    entries: Sequence[Entry] = (),
    notes: Sequence[str] = (),
    unreadable: Mapping[str, int] = NO_COUNTS,
) -> Source:
    """Return what a report of runs is made of, maybe beside the entries of a board.

    Runs of an agent that has an entry are renamed, as in "ppo of the runs".

    Args:
        title: The folder.
        records: Those in it, finished or not.
        progress: Of all runs in it.
        seconds_left: Until all of them are finished; None if unknown.
        logged: Diagnostics of some of them.
        entries: Of one board.
        notes: Sentences for the reader.
        unreadable: By suite, how many runs cannot be read.
    """
    entered = {(entry.suite, entry.agent) for entry in entries}
    renamed = [_renamed(record, entered) for record in records]
    specs = [_named(one.spec, entered) for one in progress]
    finished = [record for record in renamed if record.status == "complete"]
    return Source(
        title=title,
        results=(
            *(result for entry in entries for result in entry.results()),
            *map(Result.of, finished),
        ),
        planned=tuple(specs),
        origins=(*map(_origin_of_entry, entries), *_origins_of_runs(finished)),
        logged=tuple((_named(spec, entered), lines) for spec, lines in logged),
        progress=tuple(one._replace(spec=spec) for one, spec in zip(progress, specs, strict=True)),
        seconds_left=seconds_left,
        notes=tuple(notes),
        unreadable=unreadable,
    )


def _renamed(record: RunRecord, entered: set[tuple[str, str]]) -> RunRecord:
    spec = _named(record.spec, entered)
    return record if spec is record.spec else record.model_copy(update={"spec": spec})


def _named(spec: RunSpec, entered: set[tuple[str, str]]) -> RunSpec:
    """Return a spec under the name that it has beside a board."""
    if (spec.suite, spec.agent) not in entered:
        return spec
    return spec.model_copy(update={"agent": f"{spec.agent} of the runs"})


def _origins_of_runs(records: Sequence[RunRecord]) -> list[Origin]:
    groups: dict[tuple[str, str], list[RunRecord]] = defaultdict(list)
    for record in records:
        groups[record.spec.suite, record.spec.agent].append(record)
    return [_origin_of_runs(*key, runs) for key, runs in sorted(groups.items())]


def _origin_of_runs(suite: str, agent: str, runs: Sequence[RunRecord]) -> Origin:
    return Origin(
        suite=suite,
        agent=agent,
        runs=len(runs),
        cost=sum(run.wall_time_s for run in runs),
        memory=max(run.peak_memory_mib for run in runs),
        env_steps=sum(run.totals.env_steps for run in runs),
        devices=_distinct([run.spec.device for run in runs]),
        hardware=_distinct([_machine(run.hardware) for run in runs]),
        commits=_distinct([run.git_commit or "an installed package" for run in runs]),
        versions=_versions([run.versions for run in runs]),
        settings={run.spec.task.name: run.spec.hyperparameters for run in runs},
    )


def _origin_of_entry(entry: Entry) -> Origin:
    results = entry.results()
    return Origin(
        suite=entry.suite,
        agent=entry.agent,
        runs=len(results),
        cost=entry.wall_time_s,
        memory=None,
        env_steps=sum(result.task.budget for result in results),
        devices=_distinct([result.device for result in results]),
        hardware=_distinct([_machine(one) for one in entry.hardware]),
        commits=entry.git_commits,
        versions=entry.versions,
        settings={part.task.name: part.hyperparameters for part in entry.tasks},
        about=f"{entry.status}; {', '.join(entry.authors)}; {entry.link}",
    )


def _machine(hardware: Hardware) -> str:
    gpu = f", {hardware.gpu}" if hardware.gpu else ""
    return f"{hardware.cpu}, {hardware.cores} cores, {hardware.memory_gib:.0f} GiB{gpu}"


def _versions(found: Sequence[Mapping[str, str]]) -> dict[str, str]:
    """Return the versions of every package that one of the runs loaded."""
    names = sorted({name for versions in found for name in versions})
    return {name: ", ".join(_distinct([one[name] for one in found if name in one])) for name in names}


def _distinct(values: Sequence[str]) -> tuple[str, ...]:
    return tuple(sorted(set(values)))
