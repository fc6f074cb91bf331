"""From results to tables: which results are comparable, means with their intervals, five formats."""

from __future__ import annotations

from sprl_bench.tables.comparable import SCORED_PACKAGES, IncomparableError, check_comparable, version_differences
from sprl_bench.tables.finished import tabulate_finished
from sprl_bench.tables.render import FORMATS, render
from sprl_bench.tables.seed_results import (
    MissingRunsError,
    Result,
    describe_holes,
    find_holes,
    split_suites,
    task_names,
)
from sprl_bench.tables.table import BOOTSTRAP_SEED, Table, matrix, select_results, tabulate, tabulate_results

__all__ = [
    "BOOTSTRAP_SEED",
    "FORMATS",
    "SCORED_PACKAGES",
    "IncomparableError",
    "MissingRunsError",
    "Result",
    "Table",
    "check_comparable",
    "describe_holes",
    "find_holes",
    "matrix",
    "render",
    "select_results",
    "split_suites",
    "tabulate",
    "tabulate_finished",
    "tabulate_results",
    "task_names",
    "version_differences",
]
