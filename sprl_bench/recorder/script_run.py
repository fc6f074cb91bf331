"""One run of a script: its environments, their turns, and its record."""

from __future__ import annotations

import contextlib
import logging
import os
import time
import weakref
from collections.abc import Callable, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final, TypeVar

import gymnasium
from gymnasium.vector import AutoresetMode, VectorEnv

from sprl_bench.provenance import Provenance
from sprl_bench.recorder.episodes import EpisodeLog
from sprl_bench.recorder.fingerprint import fingerprint
from sprl_bench.recorder.identity import choose_task, identify
from sprl_bench.recorder.results import write_result
from sprl_bench.recorder.tape import Head, NoTape, Tape
from sprl_bench.recorder.wrappers import NO_TAPE, EnvRecorder, Listener, VectorRecorder
from sprl_bench.records import RunRecord, RunSpec, differences, read
from sprl_bench.records.folder import ACTIONS, CHECKPOINT, RECORD, lock, remove_leftovers
from sprl_bench.tasks import too_wide

logger = logging.getLogger("sprl_bench")

AnyEnv = TypeVar("AnyEnv", bound="gymnasium.Env[Any, Any] | VectorEnv[Any, Any, Any]")
NONE: Final[Mapping[str, Any]] = MappingProxyType({})
AGAIN: Final = (
    "The environment that record() returned earlier in this process is still open, as after a notebook's cell that ran "
    "twice: close() it to record anew."
)
UNEVEN: Final = (
    "A library that stops some environments while others go on, as a collector of whole episodes does, must collect "
    "steps, or use gymnasium.make_vec, whose environments are stepped together."
)
ELSEWHERE: Final = (
    "An environment for evaluation is made before the recording begins, or under `with recording.paused():`."
)


def spec_of(
    env: Any, *, suite: str | None, budget: int | None, score_range: tuple[float, float] | None, **rest: Any
) -> RunSpec:
    """Return the spec of an environment's run, as far as it is known at the start."""
    identity = identify(env)
    task = choose_task(identity, suite, budget, score_range)
    return RunSpec.of(*task, source="", num_envs=1, observation=identity.observation, **rest)


def run_of(spec: RunSpec, folder: Path, *, keep_actions: bool = False) -> ScriptRun:
    """Return the run that this process records in `folder`, new if there is none yet."""
    run = _LIVE.get(folder) or ScriptRun(spec, folder, keep_actions=keep_actions)
    if run.spec != spec:
        raise ValueError(f"{folder} is being recorded with {'; '.join(differences(run.spec, spec))}.")
    return run


class ScriptRun:
    """One run of a script, from its first environment to its record.

    Args:
        spec: The run; sub-environments, device and threads are filled in at the end.
        folder: The run's folder.
        keep_actions: Whether to write a tape of all actions.

    Raises:
        FileExistsError: The folder holds something that must not be replaced.
        LockedError: Another process records in this folder.
    """

    def __init__(self, spec: RunSpec, folder: Path, *, keep_actions: bool = False) -> None:
        import pyarrow.parquet  # noqa: F401, PLC0415 - it cannot be loaded at interpreter exit

        self.spec, self.folder = spec, folder
        self.held = False  # whether it stays open when all its environments are closed
        self.final = False  # whether its record has been written
        fingerprint(spec.task)  # now, for the same reason
        self._provenance = Provenance.take(spec.source)
        self._owned = contextlib.ExitStack()
        self._owned.enter_context(lock(folder))
        self._owned.callback(_LIVE.pop, folder)
        _LIVE[folder] = self
        self._process, self._started = os.getpid(), time.perf_counter()
        self._log, self._vector = self._empty_log(), False
        self._warned = False  # of too many environments
        self._open: set[_Member] = set()
        self._keep_actions, self._tape = keep_actions, NO_TAPE
        try:
            _refuse_to_replace(folder)
        except BaseException:
            self._owned.close()
            raise
        remove_leftovers(folder)
        (folder / ACTIONS).unlink(missing_ok=True)

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
            raise ValueError(f"{self.folder} is being recorded already. {AGAIN} {ELSEWHERE}")
        member = _Member(self)
        recorder: Any
        if vector:
            tape = self._tape_for(Head.of_envs, env)
            recorder = VectorRecorder(env, self.spec.task.budget, member, tape=tape)
            self._log = recorder.episode_log
        else:
            if self._vector:
                self._log = self._empty_log()
            tape = self._tape_for(Head.of, env.action_space)
            recorder = EnvRecorder(env, self._log, self._log.add_env(), member, tape=tape)
        self._vector = vector
        self._open.add(member)
        if vector:
            self._warn_of_width(self._log.num_envs)
        weakref.finalize(recorder, member.closed)  # when it is forgotten, or at the end of the process
        return recorder

    def _tape_for(self, head: Callable[[Any], Head], source: Any) -> NoTape:
        """Return the tape of this run, which begins with its first environment."""
        if self._keep_actions and self._tape is NO_TAPE:
            begun = head(source)
            self._tape = Tape(self._owned.enter_context((self.folder / ACTIONS).open("x+b")), begun)
        return self._tape

    def _empty_log(self) -> EpisodeLog:
        return EpisodeLog(0, self.spec.task.budget, AutoresetMode.DISABLED)

    def check_turn(self, steps: int) -> None:
        """Refuse the next step of an environment that is ahead of another one by a step; it has taken `steps`."""
        if os.getpid() != self._process:
            raise RuntimeError(
                f"{self.folder} is recorded by process {self._process}, but this step is taken in process "
                f"{os.getpid()}; record the environment in the process that steps it."
            )
        if not self._warned:
            self._warn_of_width(len(self._open))
        if len(self._open) > 1 and not self.final:
            slowest = min(member.steps + member.resets for member in self._open)
            if steps > slowest:
                raise RuntimeError(
                    f"{len(self._open)} environments are recorded as one run ({self.folder}), but one of them is not "
                    f"stepped in turn with the others. {UNEVEN} {ELSEWHERE} One that is no longer "
                    "needed must be closed."
                )

    def leave(self, member: _Member) -> None:
        """Write the record if this was the last open environment."""
        self._open.discard(member)
        if not self._open and not self.held:
            self.finish()

    def finish(self) -> None:
        """Write the record once, complete or not; a run without a step has none."""
        if self.final or os.getpid() != self._process:
            return
        if self._log.env_steps:
            self._write()
            self._report()
        self.final = True
        self._owned.close()

    def _write(self) -> None:
        """Write the record; if that fails, everything is kept for the next attempt."""
        made = self._provenance.completed()
        known = {"num_envs": self._log.num_stepped, "device": made.device, "torch_threads": made.torch_threads}
        wall_time_s = max(0.0, time.perf_counter() - self._started)
        self._tape.flush()
        write_result(self.folder, self.spec.model_copy(update=known), self._log, made, wall_time_s=wall_time_s)

    def _warn_of_width(self, num_envs: int) -> None:
        """Warn, once, of more environments than a leaderboard allows."""
        self._warned = True
        if fault := too_wide(self.spec.suite, self.spec.task.name, num_envs):
            logger.warning("%s.", fault)

    def _report(self) -> None:
        """Log the record; warn of abandoned episodes, or if no table will take it."""
        if self._log.complete and self._log.abandoned:
            logger.warning(
                "%s: %d of %d episodes were reset before their end; they count as failures.",
                *(self.folder, self._log.abandoned, len(self._log.episodes)),
            )
        if self._log.complete:
            logger.info("%s has its record: all of the %d env steps.", self.folder, self.spec.task.budget)
        else:
            logger.warning(
                "%s has an incomplete record, which no table takes: %d of %d env steps.",
                *(self.folder, self._log.env_steps, self.spec.task.budget),
            )


class _Member(Listener):
    """One environment of a run, with the steps and resets it has taken."""

    def __init__(self, run: ScriptRun) -> None:
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
        self.resets += self.steps > 0  # the first one is nobody's turn

    def completed(self) -> None:
        """Write the record; if the disk is full, say so and let the script go on: `close` tries again."""
        try:
            self._run.finish()
        except OSError as error:
            logger.error("%s: the record is not written yet (%s); close() tries again.", self._run.folder, error)

    def closed(self) -> None:
        self._run.leave(self)


_LIVE: Final[dict[Path, ScriptRun]] = {}


def _refuse_to_replace(folder: Path) -> None:
    if (folder / CHECKPOINT).exists():
        raise FileExistsError(f"{folder} holds an unfinished run of the command line; use another agent name or out.")
    if (folder / RECORD).exists() and read(folder / RECORD, RunRecord).status == "complete":
        raise FileExistsError(f"{folder} holds a complete record; use another seed, agent or out, or remove it.")
