"""Records of any script's run: one line around its environment, or one block around all of it.

Environments recorded under the same suite, task, agent and seed in one process are the sub-environments of one run, as
where a library makes its vector environment out of single ones. They must be stepped in turn. An environment that is
used for something else, such as evaluation, is therefore noticed at once, and must be made outside.
"""

from __future__ import annotations

import contextlib
import functools
import logging
import os
import time
import warnings
import weakref
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final, TypeVar

import gymnasium
from gymnasium.vector import AutoresetMode, VectorEnv

from sprl_bench import machine
from sprl_bench.recorder.episodes import EpisodeLog
from sprl_bench.recorder.fingerprint import fingerprint
from sprl_bench.recorder.folder import CHECKPOINT, RECORD, lock, remove_leftovers
from sprl_bench.recorder.identity import choose_task, identify
from sprl_bench.recorder.making import NAMESPACE
from sprl_bench.recorder.results import write_result
from sprl_bench.recorder.wrappers import EnvRecorder, Listener, VectorRecorder
from sprl_bench.records import RunRecord, RunSpec, differences, read

__all__ = ["Recording", "record", "recording"]

logger = logging.getLogger("sprl_bench")

AnyEnv = TypeVar("AnyEnv", bound="gymnasium.Env[Any, Any] | VectorEnv[Any, Any, Any]")
NONE: Final[Mapping[str, Any]] = MappingProxyType({})
ELSEWHERE: Final = (
    "An environment for evaluation is made before the recording begins, or under `with recording.paused():`."
)


def record(
    env: AnyEnv,
    *,
    out: str | Path,
    agent: str,
    seed: int,
    suite: str | None = None,
    budget: int | None = None,
    score_range: tuple[float, float] | None = None,
    privileged: bool = False,
    hyperparameters: Mapping[str, Any] = NONE,
) -> AnyEnv:
    """Return `env` with a recorder on it, which writes the run's record below `out`.

    The task is found by the environment's id and arguments. At the budget the record is written and final, and later
    steps pass through; on `close`, or when the process ends, what there is by then is written as incomplete. The
    environment can be wrapped and handed to any library. It behaves as before, but for two things: it wants a reset
    before its first step, and until the record is written no seed after that.

    Args:
        env: What `gymnasium.make` or `gymnasium.make_vec` returned.
        out: The root of all runs; the record goes to `<out>/<suite>/<task>/<agent>/seed-<seed>`.
        agent: What tables shall call the method.
        seed: The seed that the script runs with; it is noted, not set.
        suite: Which suite the run belongs to; by default the first one that has the task.
        budget: Environment steps, where no suite has the task. Other than the task's, they make the run "custom".
        score_range: The lowest and the highest return there can be, where no suite has the task; else (0, 1).
        privileged: Whether the method sees what an ordinary agent does not.
        hyperparameters: To be noted: names and plain values.

    Raises:
        TypeError, ValueError: An argument is not allowed, or something lies beneath the recorder.
        FileExistsError: There is a complete record, or an unfinished run of the command line, in that place.
        LockedError: Another process is recording the same run.
    """
    spec = _spec_of(
        env,
        suite=suite,
        budget=budget,
        score_range=score_range,
        agent=agent,
        seed=seed,
        privileged=privileged,
        hyperparameters=hyperparameters,
    )
    recorded: AnyEnv = _run_of(spec, spec.path(Path(out).resolve())).take_in(env)
    return recorded


def _spec_of(
    env: Any, *, suite: str | None, budget: int | None, score_range: tuple[float, float] | None, **rest: Any
) -> RunSpec:
    """Return what an environment's run is, as far as it is known at the beginning."""
    return RunSpec.of(*choose_task(identify(env), suite, budget, score_range), source="", num_envs=1, **rest)


def _run_of(spec: RunSpec, folder: Path) -> _ScriptRun:
    """Return the run of this process that is recorded there, begun if need be."""
    run = _LIVE.get(folder) or _ScriptRun(spec, folder)
    if run.spec != spec:
        raise ValueError(f"{folder} is being recorded with {'; '.join(differences(run.spec, spec))}.")
    return run


class _ScriptRun:
    """One run of a script while it goes on, from its first environment to its record.

    Args:
        spec: What it is a run of; sub-environments, device and threads are filled in at the end.
        folder: Where its record goes.

    Raises:
        FileExistsError: Something lies there that must not be replaced.
        LockedError: Another process is recording there.
    """

    def __init__(self, spec: RunSpec, folder: Path) -> None:
        import pyarrow.parquet  # noqa: F401, PLC0415 - too late to load when the interpreter shuts down

        self.spec, self.folder = spec, folder
        self.held = False  # whether it goes on when all its environments are closed
        self.final = False  # whether its record has been written
        fingerprint(spec.task)  # now, for the same reason
        machine.git_commit()  # is remembered from here on: files may change until the end
        self._owned = contextlib.ExitStack()
        self._owned.enter_context(lock(folder))
        self._owned.callback(_LIVE.pop, folder)
        _LIVE[folder] = self
        self._process, self._started = os.getpid(), time.perf_counter()
        self._log, self._vector = self._empty_log(), False
        self._open: set[_Member] = set()
        try:
            _refuse_to_replace(folder)
        except BaseException:
            self._owned.close()
            raise
        remove_leftovers(folder)

    @property
    def complete(self) -> bool:
        """Whether its record holds the whole budget."""
        return self.final and self._log.complete

    def take_in(self, env: Any) -> Any:
        """Return `env` with a recorder that writes to this run.

        Raises:
            ValueError: The run has begun without it, or one of the two is a vector environment.
        """
        vector = isinstance(env, VectorEnv)
        if self._log.env_steps or (self._open and (vector or self._vector)):
            raise ValueError(f"{self.folder} is being recorded already. {ELSEWHERE}")
        member = _Member(self)
        recorder: Any
        if vector:
            recorder = VectorRecorder(env, self.spec.task.budget, member)
            self._log = recorder.episode_log
        else:
            if self._vector:
                self._log = self._empty_log()
            recorder = EnvRecorder(env, self._log, self._log.add_env(), member)
        self._vector = vector
        self._open.add(member)
        weakref.finalize(recorder, member.closed)  # when it is forgotten, or at the end of the process
        return recorder

    def _empty_log(self) -> EpisodeLog:
        return EpisodeLog(0, self.spec.task.budget, AutoresetMode.DISABLED)

    def check_turn(self, steps: int) -> None:
        """Refuse a step, after so many, out of turn: with N environments, each steps before one takes its next."""
        if len(self._open) > 1 and not self.final:
            slowest = min(member.steps + member.resets for member in self._open)
            if steps > slowest:
                raise RuntimeError(
                    f"{len(self._open)} environments are recorded as one run ({self.folder}), but one of them is not "
                    f"stepped in turn with the others. {ELSEWHERE} One that is no longer needed must be closed."
                )

    def leave(self, member: _Member) -> None:
        """Write what there is, if this was the last of the environments."""
        self._open.discard(member)
        if not self._open and not self.held:
            self.finish()

    def finish(self) -> None:
        """Write the record, complete or not, unless that has been done; a run without a step leaves nothing."""
        if self.final or os.getpid() != self._process:
            return
        self.final = True
        with self._owned:
            if self._log.env_steps:
                known_by_now = {"num_envs": self._log.num_stepped, **machine.computing()}
                spec = self.spec.model_copy(update=known_by_now)
                write_result(self.folder, spec, self._log, wall_time_s=time.perf_counter() - self._started)
                self._report()

    def _report(self) -> None:
        """Log what was written; warn where no table will take it."""
        if self._log.complete:
            logger.info("%s has its record: all of the %d env steps.", self.folder, self.spec.task.budget)
        else:
            logger.warning(
                "%s has an incomplete record, which no table takes: %d of %d env steps.",
                self.folder,
                self._log.env_steps,
                self.spec.task.budget,
            )


class _Member(Listener):
    """One environment of a run, and what it has done so far."""

    def __init__(self, run: _ScriptRun) -> None:
        self._run = run
        self.steps = 0
        self.resets = 0  # a vector environment may spend its turn on one

    @property
    def recording(self) -> bool:
        return not self._run.final

    def stepping(self) -> None:
        self._run.check_turn(self.steps)
        self.steps += 1

    def resetting(self) -> None:
        self.resets += 1

    def completed(self) -> None:
        self._run.finish()

    def closed(self) -> None:
        self._run.leave(self)


_LIVE: Final[dict[Path, _ScriptRun]] = {}


def _refuse_to_replace(folder: Path) -> None:
    if (folder / CHECKPOINT).exists():
        raise FileExistsError(f"{folder} holds an unfinished run of the command line; use another agent name or out.")
    if (folder / RECORD).exists() and read(folder / RECORD, RunRecord).status == "complete":
        raise FileExistsError(f"{folder} holds a complete record; use another seed, agent or out, or remove it.")


class Recording:
    """A block in which every environment of ours that is made is recorded; see `recording`."""

    def __init__(self, out: Path, arguments: Mapping[str, Any]) -> None:
        self._out, self._arguments = out, arguments
        self._paused = False
        self._runs: dict[Path, _ScriptRun] = {}
        self._process = os.getpid()

    @property
    def folders(self) -> list[Path]:
        """Where the records of this block are or will be."""
        return list(self._runs)

    @contextlib.contextmanager
    def paused(self) -> Iterator[None]:
        """Leave the environments that are made inside unrecorded: those for evaluation."""
        self._paused = True
        try:
            yield
        finally:
            self._paused = False

    def made(self, env: AnyEnv) -> AnyEnv:
        """Return what shall be given to whoever made `env`."""
        made = env.unwrapped.spec
        if self._paused or made is None or not made.id.startswith(NAMESPACE):
            return env
        if os.getpid() != self._process:
            raise RuntimeError(
                "recording() does not reach into other processes: make the environments in this one, or use "
                "gymnasium.make_vec, or call record() around a vector environment that has its own processes."
            )
        spec = _spec_of(env, **self._arguments)
        folder = spec.path(self._out)
        if folder in self._runs and self._runs[folder].complete:
            warnings.warn(f"{folder} has its record by now, so a further environment is not recorded.", stacklevel=3)
            return env
        run = _run_of(spec, folder)
        run.held = True
        self._runs[run.folder] = run
        recorded: AnyEnv = run.take_in(env)
        return recorded

    def finish(self) -> None:
        """Write the records of what is not complete."""
        with contextlib.ExitStack() as all_of_them:
            for run in self._runs.values():
                all_of_them.callback(run.finish)


@contextlib.contextmanager
def recording(
    *,
    out: str | Path,
    agent: str,
    seed: int,
    suite: str | None = None,
    budget: int | None = None,
    score_range: tuple[float, float] | None = None,
    privileged: bool = False,
    hyperparameters: Mapping[str, Any] = NONE,
) -> Iterator[Recording]:
    """Record every `SPRL/` environment that `gymnasium.make` or `gymnasium.make_vec` makes inside the block.

    Each task has one record; environments of the same task are the sub-environments of one run and must be stepped in
    turn. Make those for evaluation before the block, or inside `with recording.paused():`; one that is made when the
    record is complete is not recorded, with a warning. When the block ends, whatever is not complete is written as
    incomplete. A name imported earlier, as in `from gymnasium import make`, is not seen, and neither is what other
    processes make.

    Args:
        out: See `record`, as for the others.
        agent: What tables shall call the method.
        seed: The seed that the script runs with.
        suite: Which suite the runs belong to.
        budget: Environment steps, where no suite has the task.
        score_range: The lowest and the highest return there can be, where no suite has the task.
        privileged: Whether the method sees what an ordinary agent does not.
        hyperparameters: To be noted: names and plain values.

    Raises:
        RuntimeError: The block lies within another one.
    """
    if hasattr(gymnasium.make, "_records"):
        raise RuntimeError("recording() blocks cannot lie within one another.")
    block = Recording(
        Path(out).resolve(),
        {
            "agent": agent,
            "seed": seed,
            "suite": suite,
            "budget": budget,
            "score_range": score_range,
            "privileged": privileged,
            "hyperparameters": hyperparameters,
        },
    )
    make, make_vec = gymnasium.make, gymnasium.make_vec
    gymnasium.make, gymnasium.make_vec = _recorded(make, block), _recorded(make_vec, block)
    try:
        yield block
    finally:
        gymnasium.make, gymnasium.make_vec = make, make_vec
        block.finish()
    if not block.folders:
        warnings.warn("Nothing was recorded: no SPRL/ environment was made inside recording().", stacklevel=3)


def _recorded(make: Callable[..., AnyEnv], block: Recording) -> Callable[..., AnyEnv]:
    @functools.wraps(make)
    def make_recorded(*arguments: Any, **keywords: Any) -> AnyEnv:
        return block.made(make(*arguments, **keywords))

    make_recorded._records = True  # type: ignore[attr-defined]
    return make_recorded
