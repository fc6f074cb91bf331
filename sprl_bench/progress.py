"""The progress of a suite: live bars on a terminal, plain lines elsewhere.

Both read only the runs' folders, so they work for every executor.
"""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Final, TextIO

from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.progress_bar import ProgressBar
from rich.table import Table
from rich.text import Text

from sprl_bench.durations import duration
from sprl_bench.records import InvalidFileError, RunSpec
from sprl_bench.suite import Observer, Outcome, RunState, pace_of, state_of

LIVE_S: Final = 1.0  # between two readings of the folders
PLAIN_S: Final = 10.0


def make_observer(stream: TextIO | None = None) -> Observer:
    """Return live bars if `stream` (by default the standard error) is a terminal, and plain lines if not."""
    stream = stream or sys.stderr
    return LiveProgress(Console(file=stream)) if stream.isatty() else PlainProgress(stream)


class _Overview:
    """All runs of a suite together."""

    def __init__(self, specs: Sequence[RunSpec], out: Path) -> None:
        self._specs, self._out = specs, out
        self.states: list[RunState] = []
        self.look()
        self._began, self._had = time.monotonic(), self.env_steps

    def look(self) -> None:
        """Read the folders of unfinished runs again."""
        known = {state.spec.path(self._out): state for state in self.states if state.status == "finished"}
        self.states = [known.get(spec.path(self._out)) or _state_of(spec, self._out) for spec in self._specs]
        self.running = [state for state in self.states if state.status == "running"]
        self.finished = sum(state.status == "finished" for state in self.states)
        self.budget = sum(state.spec.task.budget for state in self.states)
        self.env_steps = sum(min(state.env_steps, state.spec.task.budget) for state in self.states)

    def done(self) -> str:
        """Return one line on what is done."""
        return f"{self.finished}/{len(self.states)} runs, {self.env_steps:,}/{self.budget:,} env steps"

    def summary(self) -> str:
        """Return one line on what is done and what is left."""
        done = self.done()
        if self.finished == len(self.states):
            return done
        speed, left = pace_of(self.states, otherwise=self._mean_speed())
        return f"{done}, {speed:,.0f} steps/s, {duration(left)} left"

    def _mean_speed(self) -> float:
        """Return the env steps per second since the start: runs that are short may tell nothing while they run."""
        return (self.env_steps - self._had) / max(time.monotonic() - self._began, 1e-9)


def _state_of(spec: RunSpec, out: Path) -> RunState:
    """Return the progress of a run; one that cannot be read is about to fail, and stops no other."""
    try:
        return state_of(spec, out)
    except (InvalidFileError, OSError):
        return RunState(spec, "unknown", 0, 0.0, None)


def _label(spec: RunSpec) -> str:
    return f"{spec.agent} on {spec.task.name}, seed {spec.seed}"


def _news(outcome: Outcome) -> str:
    error = f": {outcome.error}" if outcome.error else ""
    return f"{outcome.status}: {_label(outcome.spec)}{error}"


def learning(state: RunState) -> str:
    """Return "return 0.52, success 0.60" for the episodes that ended lately, or nothing if none did."""
    if state.mean_return is None:
        return ""
    return f"return {state.mean_return:.2f}, success {state.success:.2f}"


class PlainProgress(Observer):
    """A line every ten seconds, and one for each run that ends."""

    def __init__(self, stream: TextIO, every_s: float = PLAIN_S) -> None:
        self._stream, self._every_s = stream, every_s
        self._end = threading.Event()
        self._thread = threading.Thread()

    def started(self, specs: Sequence[RunSpec], out: Path) -> None:
        """Begin to print."""
        self._overview = _Overview(specs, out)
        self._thread = threading.Thread(target=self._work, daemon=True)
        self._thread.start()

    def _work(self) -> None:
        while not self._end.wait(self._every_s):
            self._overview.look()
            runs = [f"{_label(state.spec)}: {learning(state)}" for state in self._overview.running if learning(state)]
            self._print("; ".join([self._overview.summary(), *runs]))

    def ended(self, outcome: Outcome) -> None:
        """Print the end of a run."""
        self._print(_news(outcome))

    def closed(self) -> None:
        """Print the last line."""
        self._end.set()
        self._thread.join()
        self._overview.look()
        self._print(self._overview.done())

    def _print(self, line: str) -> None:
        print(line, file=self._stream, flush=True)


class LiveProgress(Observer):
    """One bar for the suite and a line for each running run; ended runs stay above."""

    def __init__(self, console: Console) -> None:
        self._console = console
        self._seen = 0.0

    def started(self, specs: Sequence[RunSpec], out: Path) -> None:
        """Begin to draw."""
        self._overview = _Overview(specs, out)
        self._live = Live(console=self._console, get_renderable=self._picture, refresh_per_second=2, transient=True)
        self._live.start()

    def ended(self, outcome: Outcome) -> None:
        """Print the end of a run above the bars, unless it was skipped."""
        if outcome.status != "skipped":
            self._console.print(Text(_news(outcome), style="red" if outcome.status == "failed" else "green"))

    def closed(self) -> None:
        """Replace the bars by their last line."""
        self._live.stop()
        self._overview.look()
        self._console.print(self._overview.done())

    def _picture(self) -> RenderableType:
        if time.monotonic() - self._seen > LIVE_S:
            self._overview.look()
            self._seen = time.monotonic()
        overview = self._overview
        runs = Table.grid(padding=(0, 2))
        for state in overview.running:
            runs.add_row(
                Text(_label(state.spec)),
                ProgressBar(total=state.spec.task.budget, completed=state.env_steps, width=24),
                Text(f"{state.steps_per_second:,.0f} steps/s"),
                Text(f"{duration(state.seconds_left)} left"),
                Text(learning(state)),
            )
        whole = ProgressBar(total=overview.budget, completed=overview.env_steps)
        return Group(runs, whole, Text(overview.summary()))
