"""From specs to records: finished runs are skipped, interrupted ones continue, failed ones are tried again."""

from __future__ import annotations

import contextlib
import logging
import os
import sys
import traceback
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Final, Literal

from sprl_bench.executors import Executor, WorkerDiedError
from sprl_bench.records import InvalidFileError, RunRecord, RunSpec, differences, read, write, write_bytes
from sprl_bench.records.files import printable
from sprl_bench.records.folder import (
    APPEND,
    CHECKPOINT,
    ERROR,
    OUTPUT,
    RECORD,
    SPEC,
    LockedError,
    is_locked,
    lock,
    open_own,
    seeds_beside,
    tidy,
)
from sprl_bench.resume import SpecChangedError, find_finished
from sprl_bench.run import InterruptedRunError, run
from sprl_bench.tasks import too_wide

logger = logging.getLogger("sprl_bench")

SHOWN: Final = 3  # differences in one message
SHOWN_LETTERS: Final = 400  # of an error on one line
LONGEST: Final = 200_000  # letters of a traceback that are kept: its end

RunKey = tuple[str, str, str, int]


@dataclass(frozen=True)
class Outcome:
    """The end of one run; `error` is one line, empty unless it failed."""

    spec: RunSpec
    status: Literal["finished", "skipped", "failed"]
    error: str = ""


class Observer:
    """Receives the events of a suite; this one ignores them."""

    def started(self, specs: Sequence[RunSpec], out: Path) -> None:
        """The work on these runs begins; their progress can be read in their folders."""

    def ended(self, outcome: Outcome) -> None:
        """One of them has ended."""

    def closed(self) -> None:
        """No more will end."""


def run_suite(
    specs: Sequence[RunSpec],
    out: str | Path,
    *,
    executor: Executor,
    observer: Observer = Observer(),  # noqa: B008 - it has no state
    log: str = "",
    keep_actions: bool = False,
) -> list[Outcome]:
    """Work on all unfinished runs, and return the outcome of every run, in the order of `specs`.

    A run that fails writes its traceback to its folder; the others continue. `log` and `keep_actions` are those of
    `sprl_bench.run.run`.

    A run whose folder is broken, or may not be written to, fails alone.

    Raises:
        SpecChangedError: There are results under the same name with another spec. No run was started.
    """
    out = Path(out).absolute()  # workers may have another working directory
    _refuse_changes(specs, out)
    _warn_of_width(specs)
    planned = {_key(spec): _planned(spec, out) for spec in specs}
    waiting = [spec for spec in specs if planned[_key(spec)] is None]
    outcomes: dict[RunKey, Outcome] = {}
    observer.started(specs, out)
    try:
        attempt = partial(_attempt, out=out, log=log, keep_actions=keep_actions)
        with contextlib.closing(_work_on(planned.values(), waiting, out, executor, attempt)) as work:
            for outcome in work:
                outcomes[_key(outcome.spec)] = outcome
                observer.ended(outcome)
    finally:
        observer.closed()
    return [outcomes[_key(spec)] for spec in specs]


def _key(spec: RunSpec) -> RunKey:
    return spec.suite, spec.task.name, spec.agent, spec.seed


def _planned(spec: RunSpec, out: Path) -> Outcome | None:
    """Write the spec of a run that waits; return the outcome of one that is finished, or cannot begin."""
    folder = spec.path(out)
    try:
        if find_finished(folder, spec) is not None:
            tidy(folder)
            return Outcome(spec, "skipped")
        with contextlib.suppress(LockedError), lock(folder):  # the process that holds it has written the same
            write(folder / SPEC, spec, own=True)
    except (OSError, InvalidFileError) as error:  # the others go on
        return Outcome(spec, "failed", _line_of(error))
    return None


def _work_on(
    planned: Iterable[Outcome | None],
    waiting: Sequence[RunSpec],
    out: Path,
    executor: Executor,
    attempt: Callable[[RunSpec], Outcome],
) -> Generator[Outcome]:
    yield from (outcome for outcome in planned if outcome is not None)
    for spec, result in executor.map(attempt, waiting):
        if isinstance(result, WorkerDiedError):
            _leave_error(spec, out, f"{result}\n")
            yield Outcome(spec, "failed", str(result))
        else:
            yield result


def _leave_error(spec: RunSpec, out: Path, text: str) -> None:
    """Write down why a run failed, if the folder can be written to."""
    with contextlib.suppress(OSError):
        write_bytes(spec.path(out) / ERROR, text[-LONGEST:].encode(errors="backslashreplace"), own=True)


def _line_of(error: Exception) -> str:
    """Return an error's message on one printable line."""
    text = str(error) or type(error).__name__
    if isinstance(error, OSError) and error.strerror and error.filename is not None:
        text = f"{error.filename}: {error.strerror}."
    return printable(text.encode(errors="backslashreplace").decode(), SHOWN_LETTERS)


def _attempt(spec: RunSpec, out: Path, log: str, keep_actions: bool) -> Outcome:
    """Run one spec in a worker, and turn its end, or any error, into an outcome."""
    parent = os.getppid()
    try:
        with _output_to(spec.path(out) / OUTPUT):
            run(spec, out, stop=lambda: os.getppid() != parent, log=log, keep_actions=keep_actions)
    except (InterruptedRunError, LockedError) as error:
        return Outcome(spec, "failed", str(error))
    except Exception as error:  # an agent may raise anything; the other runs continue
        _leave_error(spec, out, traceback.format_exc())
        return Outcome(spec, "failed", printable(f"{type(error).__name__}: {_line_of(error)}", SHOWN_LETTERS))
    return Outcome(spec, "finished")


@contextlib.contextmanager
def _output_to(path: Path) -> Iterator[None]:
    """Redirect all output of this process, compiled code included, to a file; remove it if it stays empty."""
    saved = [os.dup(descriptor) for descriptor in (1, 2)]
    with os.fdopen(open_own(path, APPEND), "ab") as file:
        for descriptor in (1, 2):
            os.dup2(file.fileno(), descriptor)
    try:
        yield
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        for descriptor, original in zip((1, 2), saved, strict=True):
            os.dup2(original, descriptor)
            os.close(original)
        if path.exists() and path.stat().st_size == 0:
            path.unlink()


def _refuse_changes(specs: Sequence[RunSpec], out: Path) -> None:
    """Refuse specs that differ in more than the seed from a run of the same suite, task and agent."""
    changed = []
    for spec in {_key(spec)[:3]: spec for spec in specs}.values():
        for place, other in _begun(spec.path(out)):
            lines = differences(other.model_copy(update={"seed": spec.seed}), spec)
            changed += [f"{place}: {line}" for line in lines]
    if changed:
        more = f" (and {len(changed) - SHOWN} more)" if len(changed) > SHOWN else ""
        raise SpecChangedError(
            f"There are runs of another spec under the same name: {'; '.join(changed[:SHOWN])}{more}. "
            "Use another --out, or remove them."
        )


def _warn_of_width(specs: Sequence[RunSpec]) -> None:
    """Warn of runs with more sub-environments than a leaderboard allows."""
    for fault in dict.fromkeys(too_wide(spec.suite, spec.task.name, spec.num_envs) for spec in specs):
        if fault:
            logger.warning("%s.", fault)


def _begun(folder: Path) -> Iterator[tuple[Path, RunSpec]]:
    """Yield the folder and the spec of each seed beside `folder` that has results or is running."""
    for place in seeds_beside(folder):
        with contextlib.suppress(OSError, InvalidFileError):  # a broken one stops itself alone
            if (place / RECORD).exists():
                yield place, read(place / RECORD, RunRecord).spec
            elif (place / SPEC).exists() and ((place / CHECKPOINT).exists() or is_locked(place)):
                yield place, read(place / SPEC, RunSpec)
