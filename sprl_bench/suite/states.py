"""The progress of runs, read from their folders alone."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Literal, NamedTuple

from sprl_bench.records import InvalidFileError, RunRecord, RunSpec, read
from sprl_bench.records.diagnostics import parse_line
from sprl_bench.records.files import OnBroken, refuse, require_regular
from sprl_bench.records.folder import ERROR, METRICS, RECORD, SPEC, find_folders, is_locked

TAIL_BYTES: Final = 1 << 15


Status = Literal["finished", "running", "interrupted", "failed", "waiting", "unknown"]


@dataclass(frozen=True)
class RunState:
    """The progress of a run.

    Attributes:
        spec: Which run.
        status: "interrupted" if it has begun and no process works on it; "waiting" if it has not begun; "unknown" if
            one may not ask whether a process works on it.
        env_steps: Taken so far.
        steps_per_second: Over the last lines of its metrics; 0 if no process works on it.
        seconds_left: At that speed; None if unknown.
        mean_return: Of the episodes that ended lately, as the recorder saw them; None if none did.
        success: The share of these that were successful.
    """

    spec: RunSpec
    status: Status
    env_steps: int
    steps_per_second: float
    seconds_left: float | None
    mean_return: float | None = None
    success: float | None = None


class Pace(NamedTuple):
    """How quickly runs go on together, and how long all of them take; `seconds_left` is None if unknown."""

    steps_per_second: float
    seconds_left: float | None


def pace_of(states: Iterable[RunState], otherwise: float = 0.0) -> Pace:
    """Return the pace of all runs: at the speed of those that are running, or `otherwise` if they tell none."""
    states = list(states)
    steps = sum(max(0, state.spec.task.budget - state.env_steps) for state in states)
    speed = sum(state.steps_per_second for state in states) or otherwise
    return Pace(speed, steps / speed if speed else None if steps else 0.0)


def survey(
    out: str | Path, known: Iterable[tuple[Path, RunRecord]] = (), on_broken: OnBroken = refuse
) -> list[RunState]:
    """Return the state of every run below `out`, in the order of their paths.

    Args:
        out: The folder of all runs.
        known: Folders and records that are read already, as `find_recorded` returns them; finished ones are not read
            again.
        on_broken: Receives each run that cannot be read, which is then left out; by default it raises the error.

    Raises:
        FileNotFoundError: There is no such folder.
        InvalidFileError: A file there is broken, or a run lies in another's folder.
    """
    root = _normal(Path(out))
    if not root.exists():
        raise FileNotFoundError(f"{out} does not exist.")
    finished = {_normal(folder): record for folder, record in known if record.status == "complete"}
    states = []
    for folder in _folders(root, on_broken):
        try:
            states.append(_finished(folder, finished[folder]) if folder in finished else _state(folder))
        except (InvalidFileError, OSError) as error:
            on_broken(folder, error)
    return states


def _folders(root: Path, on_broken: OnBroken) -> list[Path]:
    """Return the folders of all runs, in the order of their paths."""
    return find_folders(root, (SPEC, RECORD), lambda error: on_broken(Path(error.filename), error))


def _normal(folder: Path) -> Path:
    """Return an absolute path, so that one like ".." has parents too."""
    return Path(os.path.normpath(folder.absolute()))


def _finished(folder: Path, record: RunRecord) -> RunState:
    _check_place(folder, record.spec)
    return RunState(record.spec, "finished", record.totals.env_steps, 0.0, 0.0)


def state_of(spec: RunSpec, out: Path) -> RunState:
    """Return the progress of a run."""
    folder = spec.path(out)
    if (folder / RECORD).exists():
        record = read(folder / RECORD, RunRecord)
        if record.status == "complete":
            return RunState(spec, "finished", record.totals.env_steps, 0.0, 0.0)
        if not (folder / METRICS).exists():
            return RunState(spec, "interrupted", record.totals.env_steps, 0.0, None)
    lines = _last_lines(folder / METRICS)
    env_steps, speed = _progress(lines)
    locked = is_locked(folder)
    if locked:
        left = max(0, spec.task.budget - env_steps) / speed if speed else None
        return RunState(spec, "running", env_steps, speed, left, *_recent(lines))
    status: Status = "failed" if (folder / ERROR).exists() else "interrupted" if env_steps else "waiting"
    status = "unknown" if locked is None else status
    return RunState(spec, status, env_steps, 0.0, None, *_recent(lines))


def _state(folder: Path) -> RunState:
    written = folder / SPEC
    spec = read(written, RunSpec) if written.exists() else read(folder / RECORD, RunRecord).spec
    _check_place(folder, spec)
    return state_of(spec, folder.parents[len(spec.path(Path()).parts) - 1])


def _check_place(folder: Path, spec: RunSpec) -> None:
    place = spec.path(Path())
    if folder.parts[-len(place.parts) :] != place.parts:
        raise InvalidFileError(f"{folder} holds the run that belongs in {place}; move it there, or remove it.")


def _recent(lines: Sequence[Mapping[str, Any]]) -> tuple[float | None, float | None]:
    """Return the return and the success of the last line with an episode that ended."""
    told = [line for line in lines if line.get("return") is not None and line.get("success") is not None]
    return (told[-1]["return"], told[-1]["success"]) if told else (None, None)


def _progress(lines: Sequence[Mapping[str, Any]]) -> tuple[int, float]:
    """Return the env steps taken and the recent steps per second, from the last lines of the metrics."""
    if not lines:
        return 0, 0.0
    first, last = lines[0] if len(lines) > 1 else {"env_steps": 0, "wall_time_s": 0.0}, lines[-1]
    seconds = last["wall_time_s"] - first["wall_time_s"]
    return last["env_steps"], (last["env_steps"] - first["env_steps"]) / seconds if seconds > 0 else 0.0


def _last_lines(path: Path) -> list[dict[str, Any]]:
    """Return the whole lines of the last kilobytes; the very last one may not be written to its end.

    Raises:
        InvalidFileError: It is no regular file.
    """
    try:
        require_regular(path)
        with path.open("rb") as file:
            start = max(0, file.seek(0, os.SEEK_END) - TAIL_BYTES)
            file.seek(start)
            lines = file.read().split(b"\n")
    except FileNotFoundError:
        return []
    parsed = map(parse_line, lines[1 if start else 0 : -1])  # a broken line is no reason to show nothing
    return [line for line in parsed if line.get("wall_time_s") is not None]
