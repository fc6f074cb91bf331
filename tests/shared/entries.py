"""Entries made of made-up records."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from sprl_bench import leaderboard
from sprl_bench.leaderboard import Entry
from sprl_bench.records import RunRecord


def make_entry(records: Sequence[RunRecord], agent: str = "ppo", **changes: Any) -> Entry:
    arguments: dict[str, Any] = {"authors": ["Ada L."], "link": "https://example.org/paper_1", **changes}
    return leaderboard.make_entry(records, agent=agent, **arguments)
