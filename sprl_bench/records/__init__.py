"""The files of a run: its spec and its record, checked whenever they are read."""

from __future__ import annotations

from sprl_bench.records.diagnostics import find_metrics, read_metrics
from sprl_bench.records.files import Data, InvalidFileError, locate, read, write, write_bytes
from sprl_bench.records.types import (
    Hardware,
    RunRecord,
    RunSpec,
    Scores,
    TaskSpec,
    Totals,
    differences,
    find_recorded,
    find_records,
    gather,
    hyperparameters_hash,
)

__all__ = [
    "Data",
    "Hardware",
    "InvalidFileError",
    "RunRecord",
    "RunSpec",
    "Scores",
    "TaskSpec",
    "Totals",
    "differences",
    "find_metrics",
    "find_recorded",
    "find_records",
    "gather",
    "hyperparameters_hash",
    "locate",
    "read",
    "read_metrics",
    "write",
    "write_bytes",
]
