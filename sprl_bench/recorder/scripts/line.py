"""One line around an environment."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from sprl_bench.recorder.scripts.script_run import NONE, AnyEnv, run_of, spec_of

__all__ = ["record"]


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
