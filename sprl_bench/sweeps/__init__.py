"""Sweeps: every setting of a range under the same seeds, a choice by a rule declared before the first run."""

from __future__ import annotations

from sprl_bench.sweeps.declaration import Declaration, declare, read_declaration
from sprl_bench.sweeps.expansion import read_ranges, settings_of, specs_of, table_ranges
from sprl_bench.sweeps.ranking import Ranking, rank
from sprl_bench.sweeps.report import draw_agent, write_report
from sprl_bench.sweeps.sensitivity import Sensitivity, sensitivity

__all__ = [
    "Declaration",
    "Ranking",
    "Sensitivity",
    "declare",
    "draw_agent",
    "rank",
    "read_declaration",
    "read_ranges",
    "sensitivity",
    "settings_of",
    "specs_of",
    "table_ranges",
    "write_report",
]
