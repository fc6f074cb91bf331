"""From runs to an entry: complete, for the current suite, and each task made with one set of versions."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Literal

from pydantic import ValidationError

from sprl_bench.leaderboard.entries import MINIMUM_SEEDS, Entry, SeedResult, TaskEntry
from sprl_bench.leaderboard.reference_agents import check_privileged
from sprl_bench.leaderboard.same_tasks import suites_with
from sprl_bench.records import RunRecord, RunSpec, TaskSpec, gather
from sprl_bench.records.files import first_complaint
from sprl_bench.suggestions import unknown
from sprl_bench.tables import (
    IncomparableError,
    MissingRunsError,
    Result,
    check_comparable,
    describe_holes,
    find_holes,
    version_differences,
)
from sprl_bench.tasks import SUITES, find_suite, too_wide

Status = Literal["reported", "reproduced"]


def make_entry(
    records: Iterable[RunRecord],
    *,
    agent: str,
    authors: Sequence[str],
    link: str,
    suite: str | None = None,
    status: Status = "reported",
    planned: Iterable[RunSpec] = (),
) -> Entry:
    """Return the entry of an agent's runs of one suite.

    Args:
        records: Runs of any agents and suites.
        agent: The entry's agent.
        authors: Of the agent.
        link: To a paper or to the code.
        suite: Needed only if the agent has runs of several suites.
        status: "reproduced" if someone else ran it again.
        planned: Specs of all runs that there should be: those without a record count as missing.

    Raises:
        MissingRunsError: A run is missing, or there are fewer than five seeds.
        IncomparableError: The runs are not comparable, or not of the suite's own tasks and budgets.
        ValueError: There is no such agent or suite among the records.
    """
    mine = _runs_of(list(records), agent, suite)
    complete = [record for record in mine if record.status == "complete"]
    wanted = [*planned, *(record.spec for record in mine)]
    _check_publishable(complete, [spec for spec in wanted if spec.agent == agent])
    try:
        entry = _entry(complete, tuple(authors), link, status)
    except ValidationError as error:
        raise ValueError(first_complaint(error)) from None
    check_entry(entry)
    return entry


def check_entry(entry: Entry) -> None:
    """Check an entry against its suite, and `privileged` against its agent if that is a reference agent.

    Raises:
        ValueError: It differs; the message begins with the key in the entry.
    """
    check_suite(entry)
    for part in entry.tasks:
        check_privileged(part.source, entry.privileged)


def check_suite(entry: Entry) -> None:
    """Check an entry against the current suite: version, tasks, budgets, arguments and `num_envs`.

    Raises:
        ValueError: It differs; the message begins with the key in the entry.
    """
    if entry.suite not in SUITES:
        raise ValueError("suite: " + unknown("suite", entry.suite, SUITES))
    suite = SUITES[entry.suite]
    if entry.suite_version != suite.version:
        raise ValueError(f"suite_version: it is {entry.suite_version}; suite {suite.name!r} has {suite.version}")
    names, wanted = [part.task.name for part in entry.tasks], [task.name for task in suite.tasks]
    if names != wanted:
        raise ValueError(f"tasks: they are {', '.join(names)}; suite {suite.name!r} has {', '.join(wanted)}")
    for number, (part, task) in enumerate(zip(entry.tasks, suite.tasks, strict=True)):
        for name, value in TaskSpec.of(task):
            if getattr(part.task, name) != value:
                raise ValueError(
                    f"tasks.{number}.task.{name}: it is {getattr(part.task, name)}, the suite's is {value}"
                )
        if fault := too_wide(suite.name, task.name, part.num_envs):
            raise ValueError(f"tasks.{number}.num_envs: {fault}")


def _runs_of(records: Sequence[RunRecord], agent: str, suite: str | None) -> list[RunRecord]:
    if suite is not None:
        find_suite(suite)
    mine = [record for record in records if record.spec.agent == agent and suite in (None, record.spec.suite)]
    if not any(record.status == "complete" for record in mine):
        agents = {record.spec.agent for record in records}
        if agent in agents:
            where = f" of suite {suite!r}" if suite else ""
            there = suites_with(records, agent)
            hint = f" It has runs of {there}; a script's runs are of the suite that record() is given." if there else ""
            raise MissingRunsError(f"Agent {agent!r} has no finished run{where}.{hint}")
        raise ValueError(unknown("agent among these runs:", agent, agents))
    suites = sorted({record.spec.suite for record in mine})
    if len(suites) > 1:
        raise ValueError(f"Agent {agent!r} has runs of several suites; choose one with suite: {', '.join(suites)}.")
    return mine


def _check_publishable(complete: Sequence[RunRecord], wanted: Iterable[RunSpec]) -> None:
    results = [Result.of(record) for record in complete]
    check_comparable(results)
    agent, suite = results[0].agent, find_suite(results[0].suite)
    if holes := find_holes(results, wanted, [task.name for task in suite.tasks]):
        raise MissingRunsError(f"An entry has the same seeds on all tasks of its suite; {describe_holes(holes)}.")
    seeds = {result.seed for result in results}
    if len(seeds) < MINIMUM_SEEDS:
        raise MissingRunsError(f"An entry needs at least {MINIMUM_SEEDS} seeds; {agent} has {len(seeds)}.")
    check_uniform(complete, results)


def check_uniform(complete: Sequence[RunRecord], results: Sequence[Result]) -> None:
    """Check that one version of the agent's code made all runs, and one version of each package those of a task.

    Raises:
        IncomparableError: They are not.
    """
    codes = {code for result in results for code in result.agent_codes}
    if len(codes) > 1 and complete[0].spec.source:  # a script may change between seeds; boards note it
        agent = results[0].agent
        raise IncomparableError(f"An entry has one version of its agent's code; {agent}'s file changed between runs.")
    for task in dict.fromkeys(result.task.name for result in results):
        of_task = [result for result in results if result.task.name == task]
        for package, text in version_differences(of_task).items():
            raise IncomparableError(
                f"The seeds of a task are made with one version of {package}; those of {task} have {text}."
            )


def _entry(complete: Sequence[RunRecord], authors: tuple[str, ...], link: str, status: Status) -> Entry:
    spec = complete[0].spec
    versions = _versions(complete)
    return gather(
        Entry,
        spec,
        authors=authors,
        link=link,
        status=status,
        tasks=tuple(
            _task_entry([record for record in complete if record.spec.task.name == task.name], versions)
            for task in find_suite(spec.suite).tasks
        ),
        versions=versions,
        git_commits=tuple(sorted({commit for record in complete for commit in record.git_commits})),
        agent_codes=tuple(sorted({code for record in complete for code in record.agent_codes})),
        hardware=tuple(sorted({record.hardware for record in complete}, key=repr)),
    )


def _task_entry(records: Sequence[RunRecord], of_all: dict[str, str]) -> TaskEntry:
    runs = sorted(records, key=lambda record: record.spec.seed)
    spec = runs[0].spec
    if spec.source:  # the harness sets the threads; a script has those of its machine
        _refuse_mixed(runs, "torch_threads")
    _refuse_mixed(runs, "source")
    _refuse_mixed(runs, "num_envs")
    results = tuple(gather(SeedResult, run, run.spec, run.totals) for run in runs)
    versions = {name: text for name, text in _versions(runs).items() if text != of_all[name]}
    return gather(TaskEntry, runs[0], spec, results=results, versions=versions)


def _refuse_mixed(records: Sequence[RunRecord], name: str) -> None:
    found = {getattr(record.spec, name) for record in records}
    if len(found) > 1:
        task = records[0].spec.task.name
        raise IncomparableError(f"{task}: {name} differs between seeds: {', '.join(sorted(map(repr, found)))}.")


def _versions(records: Sequence[RunRecord]) -> dict[str, str]:
    """Return the versions of all packages that any run loaded."""
    names = sorted({name for record in records for name in record.versions})
    return {
        name: ", ".join(sorted({record.versions[name] for record in records if name in record.versions}))
        for name in names
    }
