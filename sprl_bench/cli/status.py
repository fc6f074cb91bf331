"""The command that shows the progress of runs."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from sprl_bench.cli.found_runs import find_runs, warn

if TYPE_CHECKING:  # loaded when the command needs it
    from sprl_bench.suite import RunState

STATUSES = ("finished", "running", "interrupted", "failed", "waiting", "unknown")


def status(runs: Annotated[Path, typer.Argument(help="The folder of all runs.")]) -> int:
    """Show which runs are finished, running, failed or waiting; the exit status is 1 if one failed or is unreadable."""
    found = find_runs(runs)
    if not (found.states or found.broken):
        raise FileNotFoundError(f"There are no runs in {runs}.")
    for line in _summary(found.states) if found.states else ():
        typer.echo(line)
    warn(one.error for one in found.broken)
    return 1 if found.broken or any(state.status == "failed" for state in found.states) else 0


def _summary(states: Sequence[RunState]) -> list[str]:
    """Return a line for each unfinished run, and one for all."""
    from sprl_bench.durations import duration

    names = [state.status for state in states]
    total = ", ".join(f"{names.count(name)} {name}" for name in dict.fromkeys((*STATUSES, *names)) if name in names)
    running = [state.seconds_left for state in states if state.seconds_left]
    left = f"; the longest running one needs {duration(max(running))} more" if running else ""
    lines = [_progress(state) for state in states if state.status != "finished"]
    return [*lines, f"{len(states)} run{'s' * (len(states) > 1)}: {total}{left}."]


def _progress(state: RunState) -> str:
    from sprl_bench.durations import duration
    from sprl_bench.progress import learning

    spec = state.spec
    speed = f"{state.steps_per_second:,.0f} steps/s, {duration(state.seconds_left)} left"
    parts = [
        f"{state.env_steps:,} of {spec.task.budget:,} environment steps",
        speed if state.status == "running" else "",
        learning(state),
    ]
    return f"{state.status:<11}  {spec.path(Path())}  {', '.join(part for part in parts if part)}"
