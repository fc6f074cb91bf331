"""Runs of another suite that count for a board, since their tasks are the same.

Several suites hold the same task with the same budget. A script's run belongs to one of them, unless it says otherwise.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from sprl_bench.leaderboard.entries import Entry
from sprl_bench.records import RunRecord, RunSpec


def runs_for_board(
    entry: Entry, records: Iterable[RunRecord], planned: Iterable[RunSpec], agent: str | None = None
) -> tuple[list[RunRecord], list[RunSpec], list[str]]:
    """Return the runs that are compared with an entry, and notes.

    They are those of its suite. If none of them is finished, they are those of the same tasks in another suite, which
    are then taken as runs of this one.

    Args:
        entry: An entry of the board.
        records: Of any suites.
        planned: Specs of any suites.
        agent: The only agent that is asked for, or None.
    """
    everything, wanted = list(records), list(planned)
    own = [record for record in everything if record.spec.suite == entry.suite]
    if any(record.status == "complete" and agent in (None, record.spec.agent) for record in own):
        return own, [spec for spec in wanted if spec.suite == entry.suite], []
    tasks = {part.task.name: part.task for part in entry.tasks}
    same = [record for record in everything if tasks.get(record.spec.task.name) == record.spec.task]
    finished = {one.spec.suite for one in same if one.status == "complete" and agent in (None, one.spec.agent)}
    if not finished:
        return own, [spec for spec in wanted if spec.suite == entry.suite], []
    suite = min(finished)
    found = [one.model_copy(update={"spec": _moved(one.spec, entry)}) for one in same if one.spec.suite == suite]
    specs = [spec for spec in wanted if spec.suite == suite and tasks.get(spec.task.name) == spec.task]
    return found, [_moved(spec, entry) for spec in specs], [_note(suite, entry.suite)]


def _moved(spec: RunSpec, entry: Entry) -> RunSpec:
    return spec.model_copy(update={"suite": entry.suite, "suite_version": entry.suite_version})


def _note(suite: str, board: str) -> str:
    return f"The runs are of suite {suite!r}, which has the same tasks; runs of {board!r} itself have suite={board!r}."


def suites_with(records: Sequence[RunRecord], agent: str) -> str:
    """Return the names of the suites that an agent has finished runs of."""
    return ", ".join(
        sorted({one.spec.suite for one in records if one.spec.agent == agent and one.status == "complete"})
    )
