"""Where diagnostics go besides `metrics.jsonl`: TensorBoard, or a tracker of one's own.

A sink has one method. It is made in the process of the run, and cannot change the run: what it raises becomes one
warning, and the run goes on without it.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Protocol

from sprl_bench.agents import load_attribute
from sprl_bench.extras import require_extra
from sprl_bench.records import RunSpec
from sprl_bench.suggestions import unknown

logger = logging.getLogger("sprl_bench")

FOLDER = "tensorboard"  # in a run's folder


class Sink(Protocol):
    """Receives the diagnostics of one run."""

    def write(self, env_steps: int, metrics: Mapping[str, float]) -> None:
        """Take the finite numbers of one update, which ended at `env_steps`."""
        ...


SinkFactory = Callable[[RunSpec, Path, int], Sink]
"""Takes the run, its folder, and the env steps that it begins or continues at: later ones are not to be trusted."""


class NoSink:
    """Ignores everything."""

    def write(self, env_steps: int, metrics: Mapping[str, float]) -> None:
        """Do nothing."""


class TensorBoard:
    """Writes scalars for TensorBoard into the folder `tensorboard` of a run.

    Args:
        spec: The run.
        folder: Its folder.
        env_steps: That it begins or continues at; TensorBoard drops what an earlier process wrote from there on.

    Raises:
        ModuleNotFoundError: The extra `tensorboard` is not installed.
    """

    def __init__(self, spec: RunSpec, folder: Path, env_steps: int) -> None:  # noqa: ARG002 - as every sink
        writers = require_extra("tensorboard.summary.writer.event_file_writer")
        self._events = require_extra("tensorboard.compat.proto.event_pb2")
        self._summaries = require_extra("tensorboard.compat.proto.summary_pb2")
        self._writer = writers.EventFileWriter(str(folder / FOLDER), flush_secs=10)
        start = self._events.SessionLog(status=self._events.SessionLog.START)
        self._add(env_steps, session_log=start)

    def write(self, env_steps: int, metrics: Mapping[str, float]) -> None:
        """Write one value of each metric."""
        values = [self._summaries.Summary.Value(tag=name, simple_value=value) for name, value in metrics.items()]
        self._add(env_steps, summary=self._summaries.Summary(value=values))

    def _add(self, env_steps: int, **content: Any) -> None:
        self._writer.add_event(self._events.Event(wall_time=time.time(), step=env_steps, **content))
        self._writer.flush()


class Guarded:
    """Another sink, until it raises something."""

    def __init__(self, name: str, sink: Sink) -> None:
        self._name, self._sink = name, sink

    def write(self, env_steps: int, metrics: Mapping[str, float]) -> None:
        """Pass on what comes."""
        try:
            self._sink.write(env_steps, metrics)
        except Exception as error:  # whatever a tracker may do
            logger.warning("Nothing more is logged to %s: %r.", self._name, error)
            self._sink = NoSink()


def find_sink(name: str) -> SinkFactory:
    """Return the factory behind "tensorboard" or "package.module:factory"; an empty name stands for no sink.

    Raises:
        ValueError: There is no such sink.
        ModuleNotFoundError: The module, or the extra, is not installed.
    """
    if not name:
        return lambda *_: NoSink()
    if name == FOLDER:
        require_extra("tensorboard")
        return TensorBoard
    if ":" not in name:
        raise ValueError(unknown("log", name, [FOLDER]) + " Name your own as package.module:factory.")
    factory = load_attribute(name)
    if not callable(factory):
        raise ValueError(f"log is {name!r}; it must name a callable factory.")
    made: SinkFactory = factory
    return made


def make_sink(name: str, spec: RunSpec, folder: Path, env_steps: int) -> Sink:
    """Return the sink of that name for one run; one that cannot be made is named in a warning and left out."""
    try:
        return Guarded(name, find_sink(name)(spec, folder, env_steps))
    except Exception as error:  # whatever a tracker may do
        logger.warning("Nothing is logged to %s: %r.", name, error)
        return NoSink()
