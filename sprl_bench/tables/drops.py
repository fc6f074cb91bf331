"""What a table leaves out: planned runs that have no part in its numbers, each with its reason."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Final, Literal, get_args

from sprl_bench.records import Data
from sprl_bench.records.folder import run_path
from sprl_bench.tables.seed_results import Hole

Reason = Literal["failed", "interrupted", "running", "missing", "incomparable"]
REASONS: Final[tuple[str, ...]] = get_args(Reason)
SHOWN: Final = 3  # runs named for each reason


class Drop(Data):
    """A planned run that a table leaves out.

    Attributes:
        agent: Whose.
        task: On which task.
        seed: Its seed.
        reason: It failed, was interrupted, is running, has not begun ("missing"), or is not comparable.
    """

    agent: str
    task: str
    seed: int
    reason: Reason


def drops_of(
    suite: str, holes: Iterable[Hole], incomparable: Iterable[Hole], statuses: Mapping[Path, str]
) -> tuple[Drop, ...]:
    """Return what is left out, in the order of the reasons.

    Args:
        suite: Of the runs.
        holes: The runs that are missing.
        incomparable: Those that are finished and not comparable with the others.
        statuses: The status of unfinished runs, such as "failed", by their path below the folder of all runs.
    """
    unusable = set(incomparable)
    found = [_drop(one, "incomparable") for one in sorted(unusable)]
    found += [
        _drop(one, statuses.get(run_path(suite, one.task, one.agent, one.seed), "")) for one in {*holes} - unusable
    ]
    return tuple(sorted(found, key=lambda one: (REASONS.index(one.reason), one.agent, one.task, one.seed)))


def _drop(hole: Hole, status: str) -> Drop:
    known: dict[str, Reason] = {reason: reason for reason in get_args(Reason)}
    return Drop(agent=hole.agent, task=hole.task, seed=hole.seed, reason=known.get(status, "missing"))


def unfinished_text(drops: Sequence[Drop]) -> str:
    """Return how many have begun and are not finished, such as " (1 running, 2 interrupted)"; empty for none."""
    counts = Counter(one.reason for one in drops)
    parts = [f"{counts[reason]} {reason}" for reason in ("running", "interrupted", "failed") if counts[reason]]
    return f" ({', '.join(parts)})" if parts else ""


def drops_line(planned: int, drops: Sequence[Drop], unreadable: int = 0) -> str:
    """Return the line under a table that says what is left out of how many planned runs.

    Args:
        planned: How many runs were planned, of those that can be read.
        drops: What is left out of them.
        unreadable: How many folders of runs cannot be read, whatever was planned there.
    """
    runs = f"{planned} planned run{'s' * (planned != 1)}"
    lost = f" {unreadable} run{'s' * (unreadable != 1)} cannot be read." if unreadable else ""
    if not drops:
        kept = "Drops: none of those that can be read" if unreadable else "Drops: none"
        return f"{kept}; the table has {'all' if planned != 1 else 'the'} {runs}.{lost}"
    parts = [_part(reason, [one for one in drops if one.reason == reason]) for reason in REASONS]
    return f"Drops: {len(drops)} of {runs}: {'; '.join(filter(None, parts))}.{lost}"


def _part(reason: str, drops: Sequence[Drop]) -> str:
    if not drops:
        return ""
    named = [str(Hole(one.agent, one.task, one.seed)) for one in drops[:SHOWN]]
    more = [f"{len(drops) - SHOWN} more"] if len(drops) > SHOWN else []
    return f"{len(drops)} {reason} ({', '.join([*named, *more])})"
