"""Contenders, each in a process of its own: nobody sees another's threads, settings or memory."""

from __future__ import annotations

import contextlib
import importlib.util
import json
import select
import subprocess
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import psutil

from benchmarks.turns import Turn

ROOT = Path(__file__).parents[1]
SAMPLED = 0.5  # seconds between two looks at the memory of a turn


@dataclass(frozen=True)
class Contender:
    """How to start a contender.

    Attributes:
        build: A function of a module, which returns the contender's turn.
        arguments: What it is called with: numbers, texts and truth values.
        python: The interpreter to start it with.
        lacks: What must be installed before it can be measured; empty where nothing is missing.
    """

    build: Callable[..., Turn]
    arguments: Mapping[str, Any]
    python: str = sys.executable
    lacks: str = ""

    @property
    def command(self) -> list[str]:
        """The command line that starts it."""
        builder = f"{self.build.__module__}:{self.build.__name__}"
        return [self.python, "-m", "benchmarks.turns", builder, json.dumps(self.arguments)]


def contender(build: Callable[..., Turn], **arguments: Any) -> Contender:
    """Return a contender that runs on what is always installed."""
    return Contender(build, arguments)


def optional(module: str, package: str, build: Callable[..., Turn], **arguments: Any) -> Contender:
    """Return a contender that runs on a module, and so on the package that installs it."""
    found = importlib.util.find_spec(module) is not None
    return Contender(build, arguments, lacks="" if found else f"{package}: `make bench` installs it")


class Process:
    """A contender that has been started.

    Attributes:
        peak: Its peak resident memory so far, in bytes, with that of the processes that it started; 0 where the system
            does not say. Everything imported counts, and so does what a peer imports of ours to have the same task.
            Processes that have ended since count as they were seen every half second.
    """

    def __init__(self, contender: Contender) -> None:
        self.peak = 0
        self._name = " ".join(contender.command[3:])
        self._process = subprocess.Popen(
            contender.command, cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )

    def turn(self) -> float:
        """Let it take a turn, and return its rate in env steps a second."""
        assert self._process.stdin
        assert self._process.stdout
        with contextlib.suppress(BrokenPipeError):
            print(file=self._process.stdin, flush=True)
        answered = False
        while not answered:
            answered = bool(select.select([self._process.stdout], [], [], SAMPLED)[0])
            self.peak = max(self.peak, _peak(self._process.pid))
        answer = self._process.stdout.readline()
        if not answer:
            raise RuntimeError(f"{self._name} stopped; its error is printed above.")
        return float(answer)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        if kind is not None:
            self._process.kill()
        self._process.communicate()


def _peak(pid: int) -> int:
    """Return the summed peaks, in bytes, of a process and of those below it."""
    try:
        below = psutil.Process(pid).children(recursive=True)
    except psutil.NoSuchProcess:
        return 0
    return sum(map(_high_water, [pid, *(process.pid for process in below)]))


def _high_water(pid: int) -> int:
    """Return a process's peak resident memory in bytes, as Linux keeps it; 0 elsewhere and once it has ended."""
    try:
        status = Path(f"/proc/{pid}/status").read_text()
    except (FileNotFoundError, ProcessLookupError):
        return 0
    lines = dict(line.partition(":")[::2] for line in status.splitlines())
    return 1024 * int(lines.get("VmHWM", "0 kB").split()[0])
