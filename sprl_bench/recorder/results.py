"""From a log of episodes to a run's record in its folder."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from sprl_bench import scores
from sprl_bench.provenance import Provenance
from sprl_bench.recorder.episodes import EPISODE, EpisodeLog
from sprl_bench.recorder.fingerprint import fingerprint
from sprl_bench.records import RunRecord, RunSpec, Scores, TaskSpec, Totals, gather, write, write_bytes
from sprl_bench.records.folder import EPISODES, RECORD


def write_result(
    folder: Path, spec: RunSpec, log: EpisodeLog, provenance: Provenance, *, wall_time_s: float
) -> RunRecord:
    """Write a run's episodes and then its record: where there is a record, everything is written.

    Args:
        folder: The run's folder.
        spec: The run.
        log: Its episodes; the record is incomplete if the budget is not reached.
        provenance: As taken at the start; it is completed here.
        wall_time_s: Seconds, over all processes that worked on the run.
    """
    record = _record(spec, log, provenance, wall_time_s)
    write_bytes(folder / EPISODES, _parquet(log), own=True)
    write(folder / RECORD, record, own=True)
    return record


def _record(spec: RunSpec, log: EpisodeLog, provenance: Provenance, wall_time_s: float) -> RunRecord:
    of_environment = fingerprint(spec.task)  # may load packages, so before the provenance is completed
    return gather(
        RunRecord,
        provenance.completed(),
        spec=spec,
        fingerprint=of_environment,
        wall_time_s=round(wall_time_s, 3),
        **outcome(spec.task, log),
    )


def outcome(task: TaskSpec, log: EpisodeLog) -> dict[str, Any]:
    """Return the fields of a record that follow from its episodes alone."""
    episodes = log.episodes
    returns = tuple(scores.curve(episodes["stamp"], episodes["return"], task.budget).tolist())
    success = tuple(scores.curve(episodes["stamp"], episodes["success"], task.budget).tolist())
    return {
        "status": "complete" if log.complete else "incomplete",
        "return_curve": returns,
        "success_curve": success,
        "scores": Scores.of(task, returns, success),
        "totals": _totals(log),
    }


def _totals(log: EpisodeLog) -> Totals:
    episodes = log.episodes
    return Totals(
        env_steps=min(log.env_steps, log.budget),
        episodes=len(episodes),
        abandoned=log.abandoned,
        successes=int(episodes["success"].sum()),
        mean_return=scores.auc(episodes["return"]) if len(episodes) else 0.0,
        mean_length=float(episodes["length"].mean()) if len(episodes) else 0.0,
    )


def _parquet(log: EpisodeLog) -> bytes:
    import pyarrow  # noqa: PLC0415 - heavy, and needed once at the end
    from pyarrow import parquet  # noqa: PLC0415 - as above

    episodes = log.episodes
    names = EPISODE.names or ()
    table = pyarrow.Table.from_arrays([_column(episodes[name]) for name in names], names=list(names))
    buffer = io.BytesIO()
    parquet.write_table(table, buffer)
    return buffer.getvalue()


def _column(values: npt.NDArray[Any]) -> Any:
    """Return an Arrow array of raw memory: every other way loads pandas, which fails at interpreter exit."""
    import pyarrow  # noqa: PLC0415 - as above

    packed = np.packbits(values, bitorder="little") if values.dtype == np.bool_ else np.ascontiguousarray(values)
    buffers = [None, pyarrow.py_buffer(packed)]
    return pyarrow.Array.from_buffers(pyarrow.from_numpy_dtype(values.dtype), len(values), buffers)
