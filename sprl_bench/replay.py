"""Verification: the environment alone repeats a run by its kept actions, or the run is trained again.

Either way every episode, curve and score must come out the same.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode

from sprl_bench.leaderboard import Entry
from sprl_bench.leaderboard.entries import SeedResult
from sprl_bench.recorder import EnvRecorder, EpisodeLog, VectorRecorder
from sprl_bench.recorder.identity import NAMESPACE
from sprl_bench.recorder.results import outcome
from sprl_bench.recorder.tape import Close, Event, Head, Reset, Steps, UnfitForTapeError, read_tape
from sprl_bench.records import RunRecord, RunSpec, gather, read
from sprl_bench.records.files import printable, require_regular
from sprl_bench.records.folder import ACTIONS, EPISODES, RECORD, run_path
from sprl_bench.run import env_seed, make_envs, run
from sprl_bench.suggestions import unknown

MOST_ENVS: Final = 4_096  # single environments of one run
SHOWN_LETTERS: Final = 200  # of an error
UNFIT: Final = (ValueError, TypeError, LookupError, AssertionError, OverflowError, gymnasium.error.Error)
"""What environments raise for actions and seeds that are not their own."""


SEEDLESS: Final = (
    "The first reset on the tape has no seed, so its episodes cannot be repeated; give reset() a seed, or record an "
    "environment that was never reset before."
)


@dataclass(frozen=True)
class Replay:
    """What a replay of one run found; `difference` is one sentence, empty if everything is equal.

    Attributes:
        folder: The run's folder.
        record: Its record.
        env_steps: Steps that were repeated.
        difference: What is not equal, and at which step.
    """

    folder: Path
    record: RunRecord
    env_steps: int
    difference: str = ""

    @property
    def equal(self) -> bool:
        """Whether every episode, curve and score is that of the record, bit for bit."""
        return not self.difference


class NotReplayableError(ValueError):
    """The run cannot be repeated: it kept no actions, or they cannot be read."""


def verify(folder: str | Path) -> Replay:
    """Repeat a run in its environment alone, by the actions that it kept, and compare everything that is scored.

    Args:
        folder: The run's folder, with a record, its episodes and its actions.

    Raises:
        FileNotFoundError: The folder has no record.
        InvalidFileError: A file there is broken.
        NotReplayableError: The run kept no actions, or they cannot be read.
    """
    folder = Path(folder)
    if not (folder / RECORD).is_file():
        raise FileNotFoundError(f"{folder} has no {RECORD}; it must be the folder of a finished run.")
    record = read(folder / RECORD, RunRecord)
    if not (folder / ACTIONS).is_file():
        raise NotReplayableError(f"{folder} has no {ACTIONS}; the run must be made with --keep-actions.")
    _refuse_code(folder, record.spec)
    try:
        log = _replayed(record.spec, *read_tape(folder / ACTIONS))
    except UnfitForTapeError as error:
        raise NotReplayableError(str(error)) from None
    except UNFIT as error:
        text = printable(f"{type(error).__name__}: {error}", SHOWN_LETTERS)
        raise NotReplayableError(f"{folder / ACTIONS} does not fit its environment ({text}).") from error
    difference = _episodes_differ(folder / EPISODES, log) or _record_differs(record, log)
    return Replay(folder, record, log.env_steps, difference)


def _refuse_code(folder: Path, spec: RunSpec) -> None:
    """Refuse an environment that is not registered: Gymnasium would import a module that its id names.

    Raises:
        NotReplayableError: It is not.
    """
    env_id = spec.task.env_id
    if not env_id.startswith(NAMESPACE) and env_id not in gymnasium.registry:
        raise NotReplayableError(
            f"{folder} is a run in {env_id!r}, which is not registered; no code is loaded because a file names it."
        )


def verify_entry(entry: Entry, root: str | Path) -> list[Replay]:
    """Repeat the run of every row of an entry, and compare it with its record and with the entry.

    Args:
        entry: The entry.
        root: The folder of the entry's runs.

    Raises:
        FileNotFoundError: A run is missing.
        InvalidFileError: A file there is broken.
        NotReplayableError: A run kept no actions, or they cannot be read.
    """
    folders = [
        (result, Path(root) / run_path(entry.suite, part.task.name, entry.agent, result.seed))
        for part in entry.tasks
        for result in part.results
    ]
    return [_beside(verify(folder), result) for result, folder in folders]


def _beside(found: Replay, result: SeedResult) -> Replay:
    """Return what a replay found, or how the run differs from its row in an entry."""
    for name in ("return_curve", "success_curve", "scores"):
        if found.equal and getattr(found.record, name) != getattr(result, name):
            return replace(found, difference=f"{name} of the entry is not that of the record")
    return found


def row_spec(entry: Entry, task: str, seed: int) -> RunSpec:
    """Return the spec of the run behind one row of an entry, from the entry alone.

    Raises:
        ValueError: The entry has no such task or seed, or its runs were recorded by a script.
    """
    parts = {part.task.name: part for part in entry.tasks}
    if task not in parts:
        raise ValueError(unknown("task of this entry:", task, parts))
    part = parts[task]
    if seed not in part.seeds:
        raise ValueError(f"seed is {seed}; it must be one of this entry's: {', '.join(map(str, part.seeds))}.")
    if not part.source:
        raise ValueError(f"agent is {entry.agent!r}, of a script; it must be one that sprl-bench run can train.")
    return gather(RunSpec, part.results[part.seeds.index(seed)], part, entry)


def retrain(entry: Entry, task: str, seed: int, out: str | Path) -> tuple[RunRecord, str]:
    """Train one row of an entry again; return its record and how it differs from the entry, empty if it does not.

    The same curves can only be expected of the same versions on the same kind of processor.

    Args:
        entry: The entry.
        task: One of its tasks.
        seed: One of its seeds.
        out: The folder of the new run; the same call continues an interrupted one.

    Raises:
        ValueError: There is no such row, or it cannot be trained.
    """
    record = run(row_spec(entry, task, seed), Path(out))
    [row] = [one for part in entry.tasks if part.task.name == task for one in part.results if one.seed == seed]
    return record, _beside(Replay(Path(out), record, record.totals.env_steps), row).difference


def _replayed(spec: RunSpec, head: Head, events: Iterator[Event]) -> EpisodeLog:
    """Return the log of episodes of a run that is repeated."""
    if head.num_envs:
        if head.num_envs != spec.num_envs:
            raise UnfitForTapeError(f"The tape is of {head.num_envs} environments; the run has {spec.num_envs}.")
        return _replay_vector(spec, head, events)
    return _replay_singles(spec, list(events))


def _replay_vector(spec: RunSpec, head: Head, events: Iterable[Event]) -> EpisodeLog:
    own = bool(spec.source)  # our own harness seeds the environments; a script does it itself
    envs = make_envs(spec.task.env_id, head.num_envs, spec.task.arguments, autoreset=AutoresetMode(head.autoreset))
    with contextlib.closing(VectorRecorder(envs, spec.task.budget, seeded=own)) as recorder:
        if own:
            envs.reset(seed=env_seed(spec))
        begun = own
        for event in events:
            _check_goes_on(recorder.episode_log)
            if isinstance(event, Reset):
                if not begun:
                    _check_seed(event)
                begun = True
                options = None if event.mask is None else {"reset_mask": np.array(event.mask)}
                recorder.reset(seed=event.seed, options=options)
            elif isinstance(event, Steps):
                for actions in event.actions:
                    _check_goes_on(recorder.episode_log)
                    recorder.step(actions)
        return recorder.episode_log


def _replay_singles(spec: RunSpec, events: list[Event]) -> EpisodeLog:
    log = EpisodeLog(0, spec.task.budget, AutoresetMode.DISABLED)
    recorders = [_recorded(spec, log) for _ in range(_number_of_envs(events))]
    begun: set[int] = set()
    for event in events:
        _check_goes_on(log)
        if isinstance(event, Reset):
            if event.env not in begun:
                _check_seed(event)
            begun.add(event.env)
            recorders[event.env].reset(seed=event.seed)  # type: ignore[arg-type] # a single one has a single seed
        elif isinstance(event, Close):
            recorders[event.env].close()
        else:
            for env, action in zip(event.envs if event.envs is not None else (), event.actions, strict=True):
                _check_goes_on(log)
                recorders[env].step(action)
    return log


def _check_goes_on(log: EpisodeLog) -> None:
    """Refuse what follows the step that reached the budget: the recorder keeps nothing after it.

    Raises:
        UnfitForTapeError: The budget is reached.
    """
    if log.complete:
        raise UnfitForTapeError(f"The tape goes on after {log.env_steps:,} env steps; it must end at {log.budget:,}.")


def _check_seed(first: Reset) -> None:
    """Refuse a first reset without a seed: its episodes cannot be repeated.

    Raises:
        UnfitForTapeError: It has none.
    """
    seeds = first.seed if isinstance(first.seed, list) else [first.seed]
    if None in seeds:
        raise UnfitForTapeError(SEEDLESS)


def _recorded(spec: RunSpec, log: EpisodeLog) -> EnvRecorder:
    arguments: dict[str, Any] = dict(spec.task.arguments)
    return EnvRecorder(gymnasium.make(_importable(spec.task.env_id), **arguments), log, log.add_env())


def _importable(env_id: str) -> str:
    return f"sprl_bench:{env_id}" if env_id.startswith(NAMESPACE) else env_id


def _number_of_envs(events: Iterable[Event]) -> int:
    """Return how many single environments a tape has."""
    largest = -1
    for event in events:
        if isinstance(event, Steps):
            largest = max([largest, *(event.envs.tolist() if event.envs is not None else ())])
        else:
            largest = max(largest, event.env)
    if largest >= MOST_ENVS:
        raise UnfitForTapeError(f"A tape has an environment of index {largest}; it must be below {MOST_ENVS}.")
    return largest + 1


def _episodes_differ(path: Path, log: EpisodeLog) -> str:
    """Return where the episodes of a file are not those of a log, in one sentence."""
    here = log.episodes
    there = _episodes_in(path, here.dtype.names or (), log.budget)
    if isinstance(there, str):
        return there
    for name in here.dtype.names or ():
        column = np.asarray(there.column(name))
        shared = min(len(column), len(here))
        places = np.flatnonzero(column[:shared] != here[name][:shared])
        if len(places):
            first, end = places[0], here["stamp"][places[0]]
            values = f"the {name} {column[first]} in the file and {here[name][first]} in the replay"
            return f"episode {first}, which ends at env step {end}, has {values}"
    if there.num_rows != len(here):
        return f"the file has {there.num_rows} episodes and the replay {len(here)}"
    return ""


def _episodes_in(path: Path, names: Sequence[str], budget: int) -> Any:
    """Return the table of a file of episodes, or why it is none of a run; more episodes than env steps are not read.

    Raises:
        NotReplayableError: It is no such table.
    """
    from pyarrow import ArrowException, parquet  # noqa: PLC0415 - heavy

    require_regular(path)
    try:
        rows = parquet.ParquetFile(path).metadata.num_rows
        if rows > budget:
            return f"the file has {rows} episodes, which do not fit into {budget} env steps"
        return parquet.read_table(path, columns=list(names), schema=None)
    except (ArrowException, OSError, LookupError) as error:
        text = printable(str(error), SHOWN_LETTERS)
        raise NotReplayableError(f"{path} is no table of episodes ({text}).") from None


def _record_differs(record: RunRecord, log: EpisodeLog) -> str:
    """Return which field of a record is not that of a log, in one sentence."""
    replayed: Mapping[str, Any] = outcome(record.spec.task, log)
    for name, value in replayed.items():
        if getattr(record, name) != value:
            return f"{name} of the record does not follow from the replayed episodes"
    return ""
