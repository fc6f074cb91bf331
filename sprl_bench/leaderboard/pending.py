"""Finished runs that are kept beside the boards until their entry is complete.

A campaign of many hours stops and goes on, maybe on another machine. Its finished runs are merged into one file for
each agent and suite, `pending/<suite>/<agent>.json`, which holds their records whole. Once no run is missing, an entry
is made from them as it would be from the folder of all runs.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from sprl_bench.leaderboard.entries import MINIMUM_SEEDS
from sprl_bench.leaderboard.reference_agents import check_privileged
from sprl_bench.leaderboard.submission import check_uniform
from sprl_bench.records import Data, InvalidFileError, RunRecord, RunSpec, differences, read, write
from sprl_bench.records.folder import lock
from sprl_bench.suggestions import unknown
from sprl_bench.tables import IncomparableError, Result, check_comparable
from sprl_bench.tasks import SUITES

FOLDER = "pending"

RunKey = tuple[str, str, str, int]


class PendingEntry(Data):
    """The finished runs of one agent on one suite."""

    schema_version: Literal[1] = 1
    runs: Annotated[tuple[RunRecord, ...], Field(min_length=1, strict=False)]

    @property
    def agent(self) -> str:
        """The agent of all runs."""
        return self.runs[0].spec.agent

    @property
    def suite(self) -> str:
        """The suite of all runs."""
        return self.runs[0].spec.suite

    @model_validator(mode="after")
    def _holds_together(self) -> Self:
        keys = [run_key(run.spec) for run in self.runs]
        if len({key[::2] for key in keys}) > 1:
            raise ValueError("runs holds more than one agent or suite; it must hold one")
        if any(run.status != "complete" for run in self.runs):
            raise ValueError("runs holds an incomplete run; it must hold complete ones")
        if len(set(keys)) < len(keys):
            raise ValueError("runs holds one seed of one task twice; it must hold each once")
        return self


def run_key(spec: RunSpec) -> RunKey:
    """Return what names a run: suite, task, agent and seed."""
    return spec.suite, spec.task.name, spec.agent, spec.seed


def pending_path(home: str | Path, suite: str, agent: str) -> Path:
    """Return the path of the pending runs of an agent, below the folder of all boards."""
    return Path(home) / FOLDER / suite / f"{agent}.json"


def is_pending(path: Path) -> bool:
    """Return whether a file's place is one of pending runs, and not of an entry."""
    return FOLDER in path.resolve().parts[-3:-2]


def read_pending(path: str | Path) -> PendingEntry:
    """Read such a file and check its content and its path.

    Raises:
        InvalidFileError: It is invalid; the message names the file and the error.
        FileNotFoundError: There is no such file.
    """
    path = Path(path)
    pending = read(path, PendingEntry)
    place = pending_path(Path(), pending.suite, pending.agent)
    if path.resolve().parts[-3:] != place.parts:
        raise InvalidFileError(f"{path}:1: the runs of {pending.agent} on {pending.suite} belong in {place}")
    try:
        _check(pending.runs)
    except IncomparableError as error:
        raise InvalidFileError(f"{path}:1: {error}") from None
    return pending


def find_pending(folder: str | Path) -> list[PendingEntry]:
    """Read all such files in a folder `pending` or below one, in the order of their paths.

    Raises:
        InvalidFileError: One of them is invalid.
        FileNotFoundError: There is no such folder.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise FileNotFoundError(f"{folder} is no folder of pending runs.")
    paths = sorted(path for path in folder.resolve().rglob("*.json") if path.parts[-3] == FOLDER)
    return [read_pending(path) for path in paths]


def add_pending(records: Iterable[RunRecord], home: str | Path, *, agent: str, suite: str | None = None) -> list[Path]:
    """Merge the finished runs of an agent into its pending runs, and return the paths of the files.

    Args:
        records: Runs of any agents and suites; those that are not finished are left out.
        home: The folder of all boards.
        agent: The agent.
        suite: Only this suite; by default each published suite that the agent has finished runs of.

    Raises:
        IncomparableError: The runs, or those that are there, are not comparable; or one is there with other scores.
        LockedError: Another process writes there.
        ValueError: There is no finished run of this agent on a published suite.
    """
    mine = [one for one in records if one.status == "complete" and one.spec.agent == agent]
    mine = [one for one in mine if one.spec.suite in ((suite,) if suite else SUITES)]
    if not mine:
        raise ValueError(f"agent is {agent!r}; it must have a finished run of {suite or 'a published suite'}.")
    suites = sorted({record.spec.suite for record in mine})
    return [_merge([one for one in mine if one.spec.suite == name], Path(home)) for name in suites]


def _merge(records: Sequence[RunRecord], home: Path) -> Path:
    path = pending_path(home, records[0].spec.suite, records[0].spec.agent)
    with lock(path.parent):
        there = read_pending(path).runs if path.exists() else ()
        known = {run_key(run.spec): run for run in there}
        for record in records:
            _refuse_other(known.get(run_key(record.spec)), record)
        runs = [*there, *(record for record in records if run_key(record.spec) not in known)]
        _check(runs)
        write(path, PendingEntry(runs=tuple(sorted(runs, key=lambda run: _order(run.spec)))))
    return path


def _order(spec: RunSpec) -> tuple[int, int]:
    """Sort by the suite's order of tasks, then by seed."""
    return [task.name for task in SUITES[spec.suite].tasks].index(spec.task.name), spec.seed


def _refuse_other(there: RunRecord | None, record: RunRecord) -> None:
    """Refuse a run that is there with another spec or with other scores."""
    if there is None:
        return
    changed = differences(there.spec, record.spec)
    if (there.return_curve, there.success_curve) != (record.return_curve, record.success_curve):
        changed.append("other curves")
    if changed:
        name = f"seed {record.spec.seed} of {record.spec.agent} on {record.spec.task.name}"
        raise IncomparableError(f"{name} is pending already, and differs from the new run: {'; '.join(changed)}.")


def _check(runs: Sequence[RunRecord]) -> None:
    """Check that these runs can be in one entry."""
    suite = SUITES.get(runs[0].spec.suite)
    if suite is None:
        raise IncomparableError(unknown("suite", runs[0].spec.suite, SUITES))
    names = [task.name for task in suite.tasks]
    for run in runs:
        if run.spec.task.name not in names:
            raise IncomparableError(unknown(f"task of suite {suite.name!r}:", run.spec.task.name, names))
        try:
            check_privileged(run.spec.source, run.spec.privileged)
        except ValueError as error:
            raise IncomparableError(str(error)) from None
    results = [Result.of(run) for run in runs]
    check_comparable(results)
    check_uniform(runs, results)


def split_known(specs: Iterable[RunSpec], known: Iterable[PendingEntry]) -> tuple[list[RunSpec], list[RunRecord]]:
    """Divide specs into those that are still to be run, and the records of those that are pending.

    Raises:
        IncomparableError: A run of the same name is pending, but of another spec.
    """
    finished = {run_key(run.spec): run for pending in known for run in pending.runs}
    left, found = [], []
    for spec in specs:
        record = finished.get(run_key(spec))
        if record is None:
            left.append(spec)
            continue
        if changed := differences(record.spec, spec):
            name = f"seed {spec.seed} of {spec.agent} on {spec.task.name}"
            raise IncomparableError(f"{name} is pending, but as another run: {'; '.join(changed)}.")
        found.append(record)
    return left, found


def missing_runs(pending: PendingEntry, minimum: int = MINIMUM_SEEDS) -> int:
    """Return how many runs an entry still needs: each seed that is there on every task, and at least five seeds."""
    tasks = len(SUITES[pending.suite].tasks)
    seeds = max(minimum, len({run.spec.seed for run in pending.runs}))
    return tasks * seeds - len(pending.runs)
