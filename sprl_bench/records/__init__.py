"""The files of a run: its spec and its record, checked whenever they are read."""

from __future__ import annotations

from sprl_bench.records.files import Data, InvalidFileError, locate, read, write, write_bytes
from sprl_bench.records.types import (
    Count,
    Curve,
    Hardware,
    Json,
    Line,
    Name,
    RunRecord,
    RunSpec,
    Scores,
    TaskSpec,
    Totals,
    check_scores,
    differences,
    find_records,
    gather,
    hyperparameters_hash,
)

__all__ = [
    "Count",
    "Curve",
    "Data",
    "Hardware",
    "InvalidFileError",
    "Json",
    "Line",
    "Name",
    "RunRecord",
    "RunSpec",
    "Scores",
    "TaskSpec",
    "Totals",
    "check_scores",
    "differences",
    "find_records",
    "gather",
    "hyperparameters_hash",
    "locate",
    "read",
    "write",
    "write_bytes",
]
