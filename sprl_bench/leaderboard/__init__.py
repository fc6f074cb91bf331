"""Leaderboards: one folder a suite, one file an agent, and everything shown is computed from those files."""

from __future__ import annotations

from sprl_bench.leaderboard.comparison import (
    COMPARISON_FORMATS,
    Comparison,
    Difference,
    compare,
    render_comparisons,
    side_by_side,
)
from sprl_bench.leaderboard.entries import MINIMUM_SEEDS, Entry, SeedResult, TaskEntry
from sprl_bench.leaderboard.store import (
    OutdatedEntryError,
    add_entry,
    board,
    boards,
    entry_path,
    find_board,
    find_entries,
    home,
    own_home,
    read_entry,
    schema,
    validate,
)
from sprl_bench.leaderboard.submission import check_suite, make_entry

__all__ = [
    "COMPARISON_FORMATS",
    "MINIMUM_SEEDS",
    "Comparison",
    "Difference",
    "Entry",
    "OutdatedEntryError",
    "SeedResult",
    "TaskEntry",
    "add_entry",
    "board",
    "boards",
    "check_suite",
    "compare",
    "entry_path",
    "find_board",
    "find_entries",
    "home",
    "make_entry",
    "own_home",
    "read_entry",
    "render_comparisons",
    "schema",
    "side_by_side",
    "validate",
]
