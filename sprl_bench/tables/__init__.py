"""From results to tables: which results are comparable, means with their intervals, five formats."""

from __future__ import annotations

from sprl_bench.tables.comparable import SCORED_PACKAGES, IncomparableError, check_comparable, version_differences
from sprl_bench.tables.render import FORMATS, PRIVILEGED, interval_text, render
from sprl_bench.tables.seed_results import MissingRunsError, Result, describe_holes, find_holes, task_names
from sprl_bench.tables.table import BOOTSTRAP_SEED, Table, matrix, tabulate, tabulate_results
from sprl_bench.tables.text_table import GRID_FORMATS, Grid, as_json, draw, number

__all__ = [
    "BOOTSTRAP_SEED",
    "FORMATS",
    "GRID_FORMATS",
    "PRIVILEGED",
    "SCORED_PACKAGES",
    "Grid",
    "IncomparableError",
    "MissingRunsError",
    "Result",
    "Table",
    "as_json",
    "check_comparable",
    "describe_holes",
    "draw",
    "find_holes",
    "interval_text",
    "matrix",
    "number",
    "render",
    "tabulate",
    "tabulate_results",
    "task_names",
    "version_differences",
]
