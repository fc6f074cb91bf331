"""One run, in this process: a spec in, a record out, and a checkpoint in between.

The harness owns the clock, the budget and the files; the agent owns its loop and yields after each update. An
interrupted run continues from its last checkpoint and gives exactly the same record as an uninterrupted one.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import logging
import math
import operator
import os
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from gymnasium.envs.registration import make_vec
from gymnasium.vector import AutoresetMode, VectorEnv

from sprl_bench import checkpoint
from sprl_bench.agents import Agent, Playable, Resumable, load_factory
from sprl_bench.process import StopSignals, torch_set_up
from sprl_bench.provenance import Provenance
from sprl_bench.recorder import VectorRecorder
from sprl_bench.recorder.identity import NAMESPACE
from sprl_bench.recorder.results import write_result
from sprl_bench.recorder.tape import Head, Tape
from sprl_bench.records import RunRecord, RunSpec, write, write_bytes
from sprl_bench.records.folder import (
    ACTIONS,
    APPEND,
    CHECKPOINT,
    ERROR,
    METRICS,
    SPEC,
    WEIGHTS,
    lock,
    open_own,
    remove_leftovers,
)
from sprl_bench.resume import find_finished, load_checkpoint, other_build
from sprl_bench.sinks import NoSink, Sink, make_sink

logger = logging.getLogger("sprl_bench")


class InterruptedRunError(RuntimeError):
    """The run was asked to stop; the same call continues it."""


def run(
    spec: RunSpec,
    out: Path,
    *,
    checkpoint_every_s: float = 60.0,
    stop: Callable[[], bool] = lambda: False,
    log: str = "",
    keep_actions: bool = False,
) -> RunRecord:
    """Train one agent with one seed on one task, and write the run's folder below `out`.

    A finished run is read, not repeated. An interrupted run is continued if the agent is `Resumable` and the
    environments have `get_state` and `set_state`; otherwise it starts over. On SIGTERM or SIGINT the current update
    finishes, a checkpoint is written and `InterruptedRunError` is raised; a second signal acts at once.

    Args:
        spec: The run.
        out: The root of all runs.
        checkpoint_every_s: Seconds between two checkpoints; 0 for one after each update.
        stop: Called after each update; True stops the run as a signal does.
        log: Where diagnostics go besides `metrics.jsonl`: "tensorboard", or "package.module:factory" of a `Sink`.
        keep_actions: Keep every action in `actions.tape`, so that `sprl_bench.replay.verify` can repeat the run. A run
            that continues goes on as it began.

    Raises:
        InterruptedRunError: The run was asked to stop.
        SpecChangedError: The folder holds results of another spec.
        CheckpointRefusedError: The checkpoint was made with other code or versions.
        LockedError: Another process works on this run.
    """
    folder = spec.path(out.absolute())  # an agent may change the working directory
    with lock(folder):
        if (record := find_finished(folder, spec)) is not None:
            return record
        remove_leftovers(folder)
        (folder / ERROR).unlink(missing_ok=True)
        write(folder / SPEC, spec, own=True)
        with contextlib.ExitStack() as opened, StopSignals() as signals:
            active = _ActiveRun(spec, folder, opened, keep_actions=keep_actions)
            active.restore()
            active.log_to(log)
            _train(active, checkpoint_every_s, lambda: signals.received or stop())
            return active.finish()


def env_seed(spec: RunSpec) -> int:
    """Return the seed of the run's environments: 31 bits, independent for each run seed and task.

    Sub-environment i is seeded with this plus i, so consecutive seeds would share streams.
    """
    task = int.from_bytes(hashlib.sha256(spec.task.name.encode()).digest()[:8], "little")
    return int(np.random.SeedSequence([spec.seed, task]).generate_state(1)[0]) >> 1


def make_envs(
    env_id: str,
    num_envs: int,
    arguments: Mapping[str, Any],
    num_threads: int = 1,
    autoreset: AutoresetMode = AutoresetMode.SAME_STEP,
) -> VectorEnv[Any, Any, Any]:
    """Make a vector environment; a batched one uses at most `num_threads` threads.

    `make_vec` is taken from its own module: inside `recording()` the one in `gymnasium` records.
    """
    if env_id.startswith(NAMESPACE):
        mode = autoreset.value
        return make_vec(env_id, num_envs=num_envs, num_threads=num_threads, autoreset_mode=mode, **arguments)
    keywords = {"autoreset_mode": autoreset}
    return make_vec(env_id, num_envs=num_envs, vectorization_mode="sync", vector_kwargs=keywords, **arguments)


def _train(active: _ActiveRun, checkpoint_every_s: float, stop: Callable[[], bool]) -> None:
    """Let the agent train until the budget is reached."""
    last = time.monotonic()
    for metrics in active.updates():
        active.report(metrics)
        if active.complete:
            return
        if stop():
            what_next = "continues from there" if active.save() else "starts it over"
            raise InterruptedRunError(f"Interrupted after {active.env_steps} env steps; the same command {what_next}.")
        if time.monotonic() - last >= checkpoint_every_s:
            active.save()
            last = time.monotonic()
    if not active.complete:
        raise RuntimeError(
            f"Agent {active.spec.agent!r} stopped after {active.env_steps} of {active.spec.task.budget} env steps."
        )


def _checked_agent(agent: Any, spec: RunSpec) -> Agent:
    """Return what a factory has made, if it is an agent.

    Raises:
        TypeError: It has no method `train`.
    """
    if not callable(getattr(agent, "train", None)):
        raise TypeError(f"The factory of agent {spec.agent!r} returned {agent!r:.80}; it must have a method train().")
    made: Agent = agent
    return made


class _ActiveRun:
    """A run while this process works on it: the agent, the recorded environments, the clock and the open files.

    Args:
        spec: The run.
        folder: Its folder; the run continues from the checkpoint there, if it has one.
        opened: Closes what is opened here.
        keep_actions: Whether to write a tape.
    """

    def __init__(self, spec: RunSpec, folder: Path, opened: contextlib.ExitStack, *, keep_actions: bool) -> None:
        self.spec, self._folder = spec, folder
        self._started, self._earlier_s = time.perf_counter(), 0.0
        factory = load_factory(spec.source or spec.agent)
        self._provenance = Provenance.take(spec.source)
        opened.enter_context(torch_set_up(spec))
        self._agent = _checked_agent(factory(seed=spec.seed, device=spec.device, **spec.hyperparameters), spec)
        envs = make_envs(spec.task.env_id, spec.num_envs, spec.task.arguments, spec.torch_threads)
        self._envs = opened.enter_context(contextlib.closing(VectorRecorder(envs, spec.task.budget, seeded=True)))
        envs.reset(seed=env_seed(spec))
        self._metrics = opened.enter_context(os.fdopen(open_own(folder / METRICS, APPEND), "ab"))
        self._opened, self._keep_actions = opened, keep_actions
        self._reported = 0  # episodes in the means of earlier lines
        self._sink: Sink = NoSink()

    def restore(self) -> None:
        """Continue from the checkpoint, if there is one and this run can; else begin with empty metrics."""
        path = self._folder / CHECKPOINT
        if not self._resumable:
            logger.warning("This run starts over when interrupted: its agent or its environments cannot save a state.")
        state = load_checkpoint(path, self.spec, self._provenance) if self._resumable else None
        try:
            self._take(state)
        except (LookupError, ValueError, TypeError, AttributeError, RuntimeError) as error:
            raise other_build(path, error) from error
        self._truncate_metrics(state["metrics_bytes"] if state else 0)
        self._tape(state)
        if state is None:
            return
        logger.info("%s continues after %d env steps.", self._folder, self.env_steps)

    def _take(self, state: Mapping[str, Any] | None) -> None:
        """Take the state of a checkpoint; the files are changed only after all of it is taken."""
        if state is None:
            return
        for name in ("metrics_bytes", "actions_bytes"):
            if not operator.index(state[name]) >= 0:
                raise ValueError(f"{name} is {state[name]}")
        if not 0.0 <= float(state["wall_time_s"]) < math.inf:
            raise ValueError(f"wall_time_s is {state['wall_time_s']}")
        self._envs.unwrapped.set_state(state["envs"])  # type: ignore[attr-defined] # checked by _resumable
        self._envs.episode_log.load_state_dict(state["log"])
        self._agent.load_state_dict(state["agent"])  # type: ignore[attr-defined] # checked by _resumable
        self._earlier_s, self._reported = float(state["wall_time_s"]), self._envs.episode_log.num_logged
        self._provenance = self._provenance.continuing(state["provenance"])
        operator.index(state["metrics_bytes"])

    def _truncate_metrics(self, size: int) -> None:
        """Forget the lines after the checkpoint; set aside what is shorter, as after a loss of power."""
        if os.fstat(self._metrics.fileno()).st_size < size:
            aside = self._folder / f"{METRICS}.broken"
            write_bytes(aside, (self._folder / METRICS).read_bytes(), own=True)
            logger.warning("%s has lost lines, which no score depends on. It is %s now.", METRICS, aside)
            size = 0
        self._metrics.truncate(size)

    def _tape(self, state: Mapping[str, Any] | None) -> None:
        """Begin a tape if one is wanted, or continue the one of the checkpoint."""
        path = self._folder / ACTIONS
        begun = state["actions_bytes"] if state else 0
        if state and self._keep_actions and not begun:
            logger.warning("%s keeps no actions: it was begun without.", self._folder)
        if not (begun or (self._keep_actions and not state)):
            path.unlink(missing_ok=True)
            return
        file = self._opened.enter_context(os.fdopen(open_own(path, os.O_RDWR | os.O_CREAT), "r+b"))
        file.truncate(begun)
        file.seek(begun)
        self._envs.tape = Tape(file, Head.of_envs(self._envs))

    def log_to(self, log: str) -> None:
        """Send diagnostics to a sink, too."""
        self._sink = make_sink(log, self.spec, self._folder, self.env_steps)

    @property
    def env_steps(self) -> int:
        return self._envs.episode_log.env_steps

    @property
    def complete(self) -> bool:
        return self._envs.episode_log.complete

    @property
    def _wall_time_s(self) -> float:
        return self._earlier_s + max(0.0, time.perf_counter() - self._started)

    def updates(self) -> Iterator[Mapping[str, float]]:
        """Return the agent's loop.

        Raises:
            TypeError: It is none.
        """
        updates: Any = self._agent.train(self._envs, self.spec.task.budget)
        if not isinstance(updates, Iterable):
            raise TypeError(f"train() of agent {self.spec.agent!r} returned {updates!r:.80}; it must yield metrics.")
        return iter(updates)

    def report(self, metrics: Any) -> None:
        """Append one line of diagnostics; a number that is not finite is written as null.

        The harness writes `env_steps`, `wall_time_s`, `return` and `success`. An agent's metrics of these names are
        left out.
        """
        if not isinstance(metrics, Mapping):
            raise TypeError(
                f"train() of agent {self.spec.agent!r} yielded {metrics!r:.80}; it must yield a mapping of names to "
                "numbers after each update."
            )
        numbers = {name: float(value) for name, value in metrics.items()}
        own = {"env_steps": self.env_steps, "wall_time_s": round(self._wall_time_s, 3), **self._recent()}
        finite = {name: value if math.isfinite(value) else None for name, value in numbers.items() if name not in own}
        line = own | finite
        self._metrics.write(json.dumps(line).encode() + b"\n")
        self._metrics.flush()
        self._envs.tape.flush()
        self._sink.write(self.env_steps, {name: value for name, value in line.items() if value is not None})

    def _recent(self) -> dict[str, float | None]:
        """Return the mean return and success of the episodes that ended since the last line, None if none did."""
        ended = self._envs.episode_log.logged_since(self._reported)
        self._reported += len(ended)
        return {name: float(ended[name].mean()) if len(ended) else None for name in ("return", "success")}

    def save(self) -> bool:
        """Write a checkpoint if the run is resumable, and return whether it is."""
        if not self._resumable:
            return False
        state = {
            "spec": self.spec.model_dump_json(),
            "provenance": self._provenance.completed().as_dict(),
            "wall_time_s": self._wall_time_s,
            "metrics_bytes": self._size_on_disk(),
            "actions_bytes": self._envs.tape.flush(),
            "log": self._envs.episode_log.state_dict(),
            "envs": self._envs.unwrapped.get_state(),  # type: ignore[attr-defined] # checked by _resumable
            "agent": self._agent.state_dict(),  # type: ignore[attr-defined] # checked by _resumable
        }
        checkpoint.save(self._folder / CHECKPOINT, state)
        return True

    def _size_on_disk(self) -> int:
        """Return the size of the diagnostics, which reach the disk before the checkpoint that counts on them."""
        os.fsync(self._metrics.fileno())
        return self._metrics.tell()

    @property
    def _resumable(self) -> bool:
        envs = self._envs.unwrapped
        return isinstance(self._agent, Resumable) and hasattr(envs, "get_state") and hasattr(envs, "set_state")

    def finish(self) -> RunRecord:
        """Write the weights and the record, and remove the checkpoint."""
        self._keep_weights()
        self._envs.tape.flush()
        log, wall_time_s = self._envs.episode_log, self._wall_time_s
        record = write_result(self._folder, self.spec, log, self._provenance, wall_time_s=wall_time_s)
        (self._folder / CHECKPOINT).unlink(missing_ok=True)
        return record

    def _keep_weights(self) -> None:
        """Write the weights of an agent that has `policy`; an error there must not lose the record."""
        if not isinstance(self._agent, Playable):
            return
        try:
            checkpoint.save(self._folder / WEIGHTS, {"agent": self._agent.weights()})
        except Exception as error:  # whatever an agent's own method may do
            logger.warning("%s keeps no weights, so it cannot be filmed: %s", self._folder, error)
