"""What is written to disk: one run's record and what it was a run of, checked whenever it is read."""

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
