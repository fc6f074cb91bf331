"""Leaderboards: one folder a suite, one file an agent; boards are computed from these files alone."""

from __future__ import annotations

from sprl_bench.leaderboard.comparison import COMPARISON_FORMATS, compare, render_comparisons, side_by_side
from sprl_bench.leaderboard.entries import Entry
from sprl_bench.leaderboard.pending import (
    PendingEntry,
    add_pending,
    find_pending,
    missing_runs,
    pending_path,
    read_pending,
    split_known,
)
from sprl_bench.leaderboard.planning import Plan, plan_seeds, render_plans
from sprl_bench.leaderboard.store import (
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
from sprl_bench.leaderboard.submission import make_entry

__all__ = [
    "COMPARISON_FORMATS",
    "Entry",
    "PendingEntry",
    "Plan",
    "add_entry",
    "add_pending",
    "board",
    "boards",
    "compare",
    "entry_path",
    "find_board",
    "find_entries",
    "find_pending",
    "home",
    "make_entry",
    "missing_runs",
    "own_home",
    "pending_path",
    "plan_seeds",
    "read_entry",
    "read_pending",
    "render_comparisons",
    "render_plans",
    "schema",
    "side_by_side",
    "split_known",
    "validate",
]
