"""The runs of a folder as commands read them: one that cannot be read is named, and stops only what needs it."""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Collection, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final

from sprl_bench.suggestions import unknown

if TYPE_CHECKING:  # loaded when a command needs them
    from sprl_bench.records import RunRecord, RunSpec
    from sprl_bench.suite import RunState

DEPTH: Final = 4  # suite, task, agent and seed of a run's folder
REMEDY: Final = "Repair or remove that folder; --allow-missing shows the others."


@dataclass(frozen=True)
class BrokenRun:
    """A run that cannot be read; `error` is one sentence that names the file."""

    folder: Path
    error: str

    @property
    def suite(self) -> str | None:
        """Its suite by its path; None if the path tells nothing."""
        return self._part(-4)

    @property
    def agent(self) -> str | None:
        """Its agent by its path; None if the path tells nothing."""
        return self._part(-2)

    def _part(self, number: int) -> str | None:
        parts = self.folder.parts
        return parts[number] if len(parts) >= DEPTH and self.folder.name.startswith("seed-") else None

    def may_be_of(self, suites: Collection[str] | None, agent: str | None = None) -> bool:
        """Return whether it may be a run of these suites and this agent; None stands for all."""
        of_suites = suites is None or self.suite is None or self.suite in suites
        return of_suites and (agent is None or self.agent in (None, agent))


@dataclass(frozen=True)
class FoundRuns:
    """What a folder of runs holds.

    Attributes:
        recorded: The folder and the record of each run that has one.
        states: The progress of each run, begun or not.
        broken: The runs that cannot be read.
    """

    recorded: list[tuple[Path, RunRecord]]
    states: list[RunState]
    broken: list[BrokenRun]

    @property
    def records(self) -> list[RunRecord]:
        """The records of all runs that have one."""
        return [record for _, record in self.recorded]

    @property
    def planned(self) -> list[RunSpec]:
        """The spec of each run, begun or not."""
        return [state.spec for state in self.states]

    @property
    def statuses(self) -> dict[Path, str]:
        """The status of each unfinished run, by its path below the folder of all runs."""
        return {state.spec.path(Path()): state.status for state in self.states if state.status != "finished"}

    @property
    def unreadable(self) -> Counter[str]:
        """How many runs of each suite cannot be read."""
        return Counter(one.suite for one in self.broken if one.suite)

    def of(self, suites: Collection[str] | None) -> FoundRuns:
        """Return the runs of these suites; None stands for all.

        Raises:
            ValueError: There is no run of one of them.
        """
        if suites is None:
            return self
        names = {spec.suite for spec in self.planned} | {one.suite for one in self.broken if one.suite}
        for suite in suites:
            if suite not in names:
                raise ValueError(unknown("suite among these runs:", suite, names))
        return FoundRuns(
            [(folder, record) for folder, record in self.recorded if record.spec.suite in suites],
            [state for state in self.states if state.spec.suite in suites],
            [one for one in self.broken if one.may_be_of(suites)],
        )

    def refuse_broken(self, suites: Collection[str] | None = None, agent: str | None = None) -> None:
        """Refuse the broken runs that may be of these suites and this agent; name the others on stderr.

        Raises:
            InvalidFileError: There is one.
        """
        from sprl_bench.records import InvalidFileError

        needed = [one for one in self.broken if one.may_be_of(suites, agent)]
        if needed:
            raise InvalidFileError(f"{describe_broken(needed)} {REMEDY}")
        warn(one.error for one in self.broken)


def describe_broken(broken: Collection[BrokenRun]) -> str:
    """Return the sentence of the first broken run, and the number of the others."""
    first, *others = broken
    return first.error + (f" {len(others)} more cannot be read either." if others else "")


def warn(lines: Iterable[str]) -> None:
    """Print lines on stderr, printable letters only."""
    from sprl_bench.records.files import printable

    for line in lines:
        print(f"sprl-bench: {printable(line, 1000)}", file=sys.stderr)


def find_runs(folder: Path) -> FoundRuns:
    """Read all runs below a folder.

    Raises:
        FileNotFoundError: There is no such folder.
    """
    from sprl_bench.records import find_recorded
    from sprl_bench.suite import survey

    broken: dict[Path, str] = {}

    def note(place: Path, error: Exception) -> None:
        broken.setdefault(place.absolute(), sentence_of(error))

    recorded = find_recorded(folder, note)
    states = survey(folder, recorded, note)
    return FoundRuns(recorded, states, [BrokenRun(place, text) for place, text in sorted(broken.items())])


def sentence_of(error: Exception) -> str:
    """Return an error as one sentence that ends in a full stop."""
    if isinstance(error, OSError) and error.strerror and error.filename is not None:
        return f"{error.filename}: {error.strerror}."
    text = str(error) or type(error).__name__
    return text if text.endswith(".") else f"{text}."
