"""Records of any script's run: one line around its environment, or one block around all of it.

Environments recorded under the same suite, task, agent and seed in one process are the sub-environments of one run, as
where a library makes its vector environment out of single ones. They must be stepped in turn. An environment that is
used for something else, such as evaluation, is therefore noticed at once, and must be made outside.
"""

from __future__ import annotations

import contextlib
import functools
import os
import warnings
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import gymnasium

from sprl_bench.recorder.identity import NAMESPACE
from sprl_bench.recorder.script_run import NONE, AnyEnv, ScriptRun, run_of, spec_of


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
    spec = spec_of(
        env,
        suite=suite,
        budget=budget,
        score_range=score_range,
        agent=agent,
        seed=seed,
        privileged=privileged,
        hyperparameters=hyperparameters,
    )
    recorded: AnyEnv = run_of(spec, spec.path(Path(out).resolve())).take_in(env)
    return recorded


class Recording:
    """A block in which every environment of ours that is made is recorded; see `recording`."""

    def __init__(self, out: Path, arguments: Mapping[str, Any]) -> None:
        self._out, self._arguments = out, arguments
        self._paused = False
        self._runs: dict[Path, ScriptRun] = {}
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
        spec = spec_of(env, **self._arguments)
        folder = spec.path(self._out)
        if folder in self._runs and self._runs[folder].complete:
            warnings.warn(f"{folder} has its record by now, so a further environment is not recorded.", stacklevel=3)
            return env
        run = run_of(spec, folder)
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

    make_recorded._records = True  # type: ignore[attr-defined] # a mark of ours
    return make_recorded
