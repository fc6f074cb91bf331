"""One run, in this process: a spec in, a record out, and a checkpoint in between.

The harness owns the clock, the budget and the files; the agent owns its loop and yields after each update. A run that
was interrupted goes on from its last checkpoint and comes to exactly what it would have come to.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import logging
import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from gymnasium.envs.registration import make_vec
from gymnasium.vector import AutoresetMode, VectorEnv

from sprl_bench import checkpoint, provenance
from sprl_bench.agents import Playable, Resumable, load_factory
from sprl_bench.process import StopSignals, torch_set_up
from sprl_bench.recorder import VectorRecorder
from sprl_bench.recorder.identity import NAMESPACE
from sprl_bench.recorder.results import write_result
from sprl_bench.records import RunRecord, RunSpec, differences, read, write
from sprl_bench.records.folder import CHECKPOINT, ERROR, METRICS, RECORD, SPEC, WEIGHTS, lock, remove_leftovers

logger = logging.getLogger("sprl_bench")

MANY_COMMITS = 6  # what fits a line of a record, at 47 letters with "-dirty" and a comma


class InterruptedRunError(RuntimeError):
    """The run was asked to stop; starting it again goes on."""


class SpecChangedError(ValueError):
    """The folder holds a run of another spec under the same name."""


class CheckpointRefusedError(ValueError):
    """A whole checkpoint, but one from which this process would not go on exactly."""


def run(
    spec: RunSpec, out: Path, *, checkpoint_every_s: float = 60.0, stop: Callable[[], bool] = lambda: False
) -> RunRecord:
    """Train one agent with one seed on one task, and write the run's folder below `out`.

    A finished run is returned as it stands; an interrupted one is continued, provided that the agent is `Resumable`
    and the environments have `get_state` and `set_state`, and started over otherwise. SIGTERM and SIGINT let the
    current update finish, write a checkpoint and raise; a second one acts at once.

    Args:
        spec: The run.
        out: The root of all runs.
        checkpoint_every_s: Seconds between two checkpoints; 0 for one after each update.
        stop: Asked after each update whether to stop as on a signal.

    Raises:
        InterruptedRunError: The run was asked to stop.
        SpecChangedError: The folder holds results of another spec.
        CheckpointRefusedError: The checkpoint was made with other versions of what can move a number.
        LockedError: Another process is at work on this run.
    """
    folder = spec.path(out)
    with lock(folder):
        if (record := find_finished(folder, spec)) is not None:
            return record
        remove_leftovers(folder)
        (folder / ERROR).unlink(missing_ok=True)
        write(folder / SPEC, spec)
        with contextlib.ExitStack() as opened, StopSignals() as signals:
            session = _Session(spec, folder, opened)
            _train(session, checkpoint_every_s, lambda: signals.received or stop())
            return session.finish()


def find_finished(folder: Path, spec: RunSpec) -> RunRecord | None:
    """Return the complete record of `spec` in this folder, or None where there is none yet.

    Raises:
        SpecChangedError: There are results, but of another spec.
        InvalidFileError: A file in the folder is broken.
    """
    if (folder / RECORD).exists():
        record = read(folder / RECORD, RunRecord)
        _refuse_changes(folder, record.spec, spec)
        return record if record.status == "complete" else None
    if (folder / CHECKPOINT).exists() and (folder / SPEC).exists():
        _refuse_changes(folder, read(folder / SPEC, RunSpec), spec)
    return None


def _refuse_changes(folder: Path, on_disk: RunSpec, now: RunSpec) -> None:
    if changed := differences(on_disk, now):
        raise SpecChangedError(
            f"{folder} holds a run of another spec: {'; '.join(changed)}. Use another --out, or remove that folder."
        )


def env_seed(spec: RunSpec) -> int:
    """Return the seed of the run's environments: 31 bits, independent from run to run and from task to task.

    Sub-environment i is seeded with this plus i, so seeds that followed one another would share their streams.
    """
    task = int.from_bytes(hashlib.sha256(spec.task.name.encode()).digest()[:8], "little")
    return int(np.random.SeedSequence([spec.seed, task]).generate_state(1)[0]) >> 1


def make_envs(
    env_id: str, num_envs: int, arguments: Mapping[str, Any], num_threads: int = 1
) -> VectorEnv[Any, Any, Any]:
    """Make a vector environment in SameStep mode; a batched one uses so many threads at most.

    `make_vec` is taken from its own module: inside `recording()` the one in `gymnasium` records.
    """
    if env_id.startswith(NAMESPACE):
        return make_vec(env_id, num_envs=num_envs, num_threads=num_threads, **arguments)
    mode = {"autoreset_mode": AutoresetMode.SAME_STEP}
    return make_vec(env_id, num_envs=num_envs, vectorization_mode="sync", vector_kwargs=mode, **arguments)


def _train(session: _Session, checkpoint_every_s: float, stop: Callable[[], bool]) -> None:
    """Let the agent train until the budget is reached."""
    last = time.monotonic()
    for metrics in session.updates():
        session.report(metrics)
        if session.complete:
            return
        if stop():
            what_next = "goes on from there" if session.save() else "starts it over"
            raise InterruptedRunError(f"Interrupted after {session.env_steps} env steps; the same command {what_next}.")
        if time.monotonic() - last >= checkpoint_every_s:
            session.save()
            last = time.monotonic()
    if not session.complete:
        raise RuntimeError(
            f"Agent {session.spec.agent!r} stopped after {session.env_steps} of {session.spec.task.budget} env steps."
        )


class _Session:
    """A run while this process works on it: the agent, the recorded environments, the clock and the open files.

    Args:
        spec: The run.
        folder: Its folder; if a checkpoint lies there, the run goes on from it.
        opened: Takes over the closing of what is opened.
    """

    def __init__(self, spec: RunSpec, folder: Path, opened: contextlib.ExitStack) -> None:
        self.spec, self._folder = spec, folder
        self._started = time.perf_counter()
        self._earlier_s, self._earlier_peak_mib = 0.0, 0.0
        self._commits = [provenance.git_commit()]
        factory = load_factory(spec.source or spec.agent)
        self._code, self._processor = provenance.agent_code(spec.source), provenance.hardware().cpu
        opened.enter_context(torch_set_up(spec))
        self._agent = factory(seed=spec.seed, device=spec.device, **spec.hyperparameters)
        envs = make_envs(spec.task.env_id, spec.num_envs, spec.task.arguments, spec.torch_threads)
        self._envs = opened.enter_context(contextlib.closing(VectorRecorder(envs, spec.task.budget, seeded=True)))
        envs.reset(seed=env_seed(spec))
        state = self._saved_state()
        self._metrics = opened.enter_context((folder / METRICS).open("ab"))
        self._metrics.truncate(state["metrics_bytes"] if state else 0)
        if state:
            self._restore(state)

    @property
    def env_steps(self) -> int:
        return self._envs.episode_log.env_steps

    @property
    def complete(self) -> bool:
        return self._envs.episode_log.complete

    @property
    def _wall_time_s(self) -> float:
        return self._earlier_s + time.perf_counter() - self._started

    def updates(self) -> Iterator[Mapping[str, float]]:
        """Return the agent's loop."""
        return self._agent.train(self._envs, self.spec.task.budget)

    def report(self, metrics: Mapping[str, float]) -> None:
        """Append one line of diagnostics; a number that is not finite is written as null.

        Steps and time are the harness's own: metrics of these names are left out.
        """
        numbers = {name: float(value) for name, value in metrics.items()}
        own = {"env_steps": self.env_steps, "wall_time_s": round(self._wall_time_s, 3)}
        finite = {name: value if math.isfinite(value) else None for name, value in numbers.items() if name not in own}
        line = own | finite
        self._metrics.write(json.dumps(line).encode() + b"\n")
        self._metrics.flush()

    def save(self) -> bool:
        """Write a checkpoint if this run can have one, and return whether it can."""
        if not self._resumable:
            return False
        state = {
            "spec": self.spec.model_dump_json(),
            "versions": provenance.versions(),
            "git_commits": self._commits,
            "agent_code": self._code,
            "processor": self._processor,
            "wall_time_s": self._wall_time_s,
            "peak_memory_mib": max(self._earlier_peak_mib, provenance.peak_memory_mib()),
            "metrics_bytes": self._metrics.tell(),
            "log": self._envs.episode_log.state_dict(),
            "envs": self._envs.unwrapped.get_state(),  # type: ignore[attr-defined] # checked by _resumable
            "agent": self._agent.state_dict(),  # type: ignore[attr-defined] # checked by _resumable
        }
        checkpoint.save(self._folder / CHECKPOINT, state)
        return True

    @property
    def _resumable(self) -> bool:
        envs = self._envs.unwrapped
        return isinstance(self._agent, Resumable) and hasattr(envs, "get_state") and hasattr(envs, "set_state")

    def _saved_state(self) -> dict[str, Any] | None:
        """Return the state to go on from, or None to start from the beginning; the log says why."""
        if not self._resumable:
            logger.warning("This run starts over when interrupted: its agent or its environments cannot save a state.")
            return None
        try:
            state = checkpoint.load(self._folder / CHECKPOINT)
        except FileNotFoundError:
            return None
        except checkpoint.BrokenCheckpointError as error:
            logger.warning("%s The run starts over.", error)
            return None
        self._refuse(state)
        return state

    def _refuse(self, state: Mapping[str, Any]) -> None:
        path = self._folder / CHECKPOINT
        if changed := differences(RunSpec.model_validate_json(state["spec"]), self.spec):
            raise CheckpointRefusedError(f"{path} is of another run: {'; '.join(changed)}.")
        loaded, then = provenance.versions(), state["versions"]
        now = {name: loaded.get(name) or provenance.installed(name) for name in then}  # some are loaded only later
        other = [f"{name} {then[name]} then, {now[name]} now" for name in then if now[name] != then[name]]
        if other:
            raise CheckpointRefusedError(
                f"{path} was made with {'; '.join(other)}: install what was there, or remove it to start over."
            )
        if state.get("agent_code", self._code) != self._code:
            raise CheckpointRefusedError(
                f"{path} was made with other code of {self.spec.source}: bring that back, or remove it to start over."
            )
        if (processor := state.get("processor", self._processor)) != self._processor:
            logger.warning(
                "%s was made on another processor (%s then, %s now): the last bits of what follows may differ.",
                path,
                processor,
                self._processor,
            )

    def _restore(self, state: Mapping[str, Any]) -> None:
        try:
            self._envs.unwrapped.set_state(state["envs"])  # type: ignore[attr-defined] # checked by _resumable
            self._envs.episode_log.load_state_dict(state["log"])
        except (KeyError, ValueError) as error:
            raise CheckpointRefusedError(
                f"{self._folder / CHECKPOINT} was made by another build of sprl-bench ({error}): go on with that one, "
                "or remove it to start over."
            ) from None
        self._agent.load_state_dict(state["agent"])  # type: ignore[attr-defined] # checked by _resumable
        self._earlier_s, self._earlier_peak_mib = state["wall_time_s"], state["peak_memory_mib"]
        self._commits = list(dict.fromkeys([*state["git_commits"], *self._commits]))
        logger.info("%s goes on after %d env steps.", self._folder, self.env_steps)

    def finish(self) -> RunRecord:
        """Write what the agent has learned and the record, and remove what only an unfinished run needs."""
        self._keep_weights()
        record = write_result(
            self._folder,
            self.spec,
            self._envs.episode_log,
            wall_time_s=self._wall_time_s,
            peak_memory_mib=self._earlier_peak_mib,
            git_commit=_joined([commit for commit in self._commits if commit]),
            agent_code=self._code,
        )
        (self._folder / CHECKPOINT).unlink(missing_ok=True)
        return record

    def _keep_weights(self) -> None:
        """Write what the agent has learned, if it can show it; a record does not depend on that."""
        if not isinstance(self._agent, Playable):
            return
        try:
            checkpoint.save(self._folder / WEIGHTS, {"agent": self._agent.weights()})
        except Exception as error:  # whatever an agent's own method may do
            logger.warning("%s keeps no weights, so it cannot be filmed: %s", self._folder, error)


def _joined(commits: Sequence[str]) -> str | None:
    """Return the commits of a run's parts in one short line: where they are many, the first and the last."""
    if len(commits) <= MANY_COMMITS:
        return ", ".join(commits) or None
    return f"{commits[0]}, {len(commits) - 2} others, {commits[-1]}"
