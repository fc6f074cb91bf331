"""From records to what people read: tables with their intervals, in five formats."""

from __future__ import annotations

from sprl_bench.tables.render import FORMATS, render
from sprl_bench.tables.table import Cell, Estimate, Row, Table, tabulate, tabulate_results

__all__ = ["FORMATS", "Cell", "Estimate", "Row", "Table", "render", "tabulate", "tabulate_results"]
