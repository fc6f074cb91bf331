"""Records of any script's run: one line around its environment, or one block around all of it.

In one process, environments with the same suite, task, agent and seed are the sub-environments of one run, as in a
library's own vector environment. They must be stepped in turn, so an environment for evaluation is an error at once: it
must be made outside.
"""

from __future__ import annotations

import contextlib
import functools
import os
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import gymnasium

from sprl_bench.recorder.foreign_workers import refusing_workers
from sprl_bench.recorder.identity import NAMESPACE
from sprl_bench.recorder.script_run import NONE, AnyEnv, ScriptRun, run_of, spec_of

HERE_ONLY: Final = (
    "recording() does not reach into other processes: make the environments in this one, or use gymnasium.make_vec, or "
    "call record() around a vector environment that has its own processes."
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
    information: Sequence[str] = (),
    hyperparameters: Mapping[str, Any] = NONE,
    keep_actions: bool = False,
) -> AnyEnv:
    """Return `env` with a recorder on it, which writes the run's record below `out`.

    The task is found by the environment's id and arguments. At the budget the final record is written, and later steps
    pass through. On an earlier `close`, or when the process ends, an incomplete record is written. The environment can
    be wrapped and given to any library. Two things differ: its first step needs a reset before it, and no later reset
    may have a seed until the record is written.

    Args:
        env: As returned by `gymnasium.make` or `gymnasium.make_vec`.
        out: The root of all runs; the record goes to `<out>/<suite>/<task>/<agent>/seed-<seed>`.
        agent: The method's name in tables.
        seed: The seed of the script; it is noted, not set.
        suite: Which suite the run belongs to; by default the first one that has the task.
        budget: Environment steps, for a task of no suite. A budget other than the task's makes the run "custom".
        score_range: Lowest and highest return, for a task of no suite; by default (0, 1).
        privileged: Whether the method sees more than an ordinary agent.
        information: What else it uses: "relabelling" (rewards of goals that it did not pursue), "resetting" (returns to
            earlier states), "shaped" (another reward than the task's).
        hyperparameters: Names and plain values, to be noted.
        keep_actions: Keep every action in `actions.tape` beside the record, for `sprl-bench verify`.

    Raises:
        TypeError, ValueError: An argument is not allowed, or a wrapper lies beneath the recorder.
        FileExistsError: The folder holds a complete record, or an unfinished run of the command line.
        LockedError: Another process is recording the same run.
    """
    task: dict[str, Any] = {"suite": suite, "budget": budget, "score_range": score_range}
    about: dict[str, Any] = {"agent": agent, "seed": seed, "privileged": privileged, "hyperparameters": hyperparameters}
    about["information"] = tuple(information)
    spec = spec_of(env, **task, **about)
    run = run_of(spec, spec.path(Path(out).resolve()), keep_actions=keep_actions)
    recorded: AnyEnv = run.take_in(env)
    return recorded


class Recording:
    """A block in which each new environment of this package is recorded; see `recording`."""

    def __init__(self, out: Path, arguments: Mapping[str, Any], *, keep_actions: bool = False) -> None:
        self._out, self._arguments, self._keep_actions = out, arguments, keep_actions
        self._paused = False
        self._runs: dict[Path, ScriptRun] = {}
        self._process = os.getpid()

    @property
    def folders(self) -> list[Path]:
        """The folders of this block's records, written or not."""
        return list(self._runs)

    @property
    def is_paused(self) -> bool:
        """Whether environments that are made now are not recorded."""
        return self._paused

    @contextlib.contextmanager
    def paused(self) -> Iterator[None]:
        """Do not record the environments that are made inside, such as those for evaluation."""
        self._paused = True
        try:
            yield
        finally:
            self._paused = False

    def made(self, env: AnyEnv) -> AnyEnv:
        """Return the environment to use instead of a new `env`: recorded, or `env` itself."""
        made = env.unwrapped.spec
        if self._paused or made is None or not made.id.startswith(NAMESPACE):
            return env
        if os.getpid() != self._process:
            raise RuntimeError(HERE_ONLY)
        spec = spec_of(env, **self._arguments)
        folder = spec.path(self._out)
        if folder in self._runs and self._runs[folder].complete:
            warnings.warn(f"{folder} has its record by now, so a further environment is not recorded.", stacklevel=3)
            return env
        run = run_of(spec, folder, keep_actions=self._keep_actions)
        run.held = True
        self._runs[run.folder] = run
        recorded: AnyEnv = run.take_in(env)
        return recorded

    def __getstate__(self) -> Any:
        """Refuse to be sent to another process, with a `make` that records."""
        raise RuntimeError(HERE_ONLY)

    def finish(self) -> None:
        """Write the incomplete records."""
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
    information: Sequence[str] = (),
    hyperparameters: Mapping[str, Any] = NONE,
    keep_actions: bool = False,
) -> Iterator[Recording]:
    """Record every `SPRL/` environment that `gymnasium.make` or `gymnasium.make_vec` makes inside the block.

    Each task has one record; environments of the same task are the sub-environments of one run and must be stepped in
    turn. Make those for evaluation before the block, or inside `with recording.paused():`. After a record is complete,
    further environments of its task are not recorded, with a warning. When the block ends, unfinished runs are written
    as incomplete. Environments of other processes are not recorded, nor those of a `make` imported by name; vector
    environments of other libraries that start processes raise an error, such as `SubprocVecEnv` of Stable-Baselines3
    and `SubprocVectorEnv` of Tianshou.

    The arguments are those of `record`.

    Raises:
        RuntimeError: The block lies within another one.
    """
    if hasattr(gymnasium.make, "_records"):
        raise RuntimeError("recording() blocks cannot lie within one another.")
    task = {"suite": suite, "budget": budget, "score_range": score_range}
    about = {"agent": agent, "seed": seed, "privileged": privileged, "hyperparameters": hyperparameters}
    about["information"] = tuple(information)
    block = Recording(Path(out).resolve(), {**task, **about}, keep_actions=keep_actions)
    make, make_vec = gymnasium.make, gymnasium.make_vec
    gymnasium.make, gymnasium.make_vec = _recorded(make, block), _recorded(make_vec, block)
    try:
        with refusing_workers(lambda: block.is_paused):
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

    make_recorded._records = True  # type: ignore[attr-defined] # our own mark
    return make_recorded
