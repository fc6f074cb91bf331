"""What is written to disk: one run's record and what it was a run of, checked whenever it is read."""

from __future__ import annotations

from sprl_bench.records.files import Data, InvalidFileError, read, write, write_bytes
from sprl_bench.records.types import (
    Curve,
    Hardware,
    Name,
    RunRecord,
    RunSpec,
    Scores,
    TaskSpec,
    Totals,
    check_scores,
    find_records,
    hyperparameters_hash,
)

__all__ = [
    "Curve",
    "Data",
    "Hardware",
    "InvalidFileError",
    "Name",
    "RunRecord",
    "RunSpec",
    "Scores",
    "TaskSpec",
    "Totals",
    "check_scores",
    "find_records",
    "hyperparameters_hash",
    "read",
    "write",
    "write_bytes",
]
