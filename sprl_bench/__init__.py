"""sprl-bench: the benchmark for sparse-reward reinforcement learning.

Importing this package registers its environments with Gymnasium; everything else is loaded when it is first used. Each
command of `sprl-bench` has a function here.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from sprl_bench.envs import register

if TYPE_CHECKING:
    from sprl_bench.agents import agent_names
    from sprl_bench.executors import make_executor
    from sprl_bench.known_answers import check_agent
    from sprl_bench.leaderboard import (
        add_entry,
        boards,
        compare,
        find_entries,
        make_entry,
        plan_seeds,
        render_comparisons,
        validate,
    )
    from sprl_bench.plots import plot
    from sprl_bench.recorder import record, recording
    from sprl_bench.records import RunRecord, RunSpec, find_records
    from sprl_bench.replay import verify
    from sprl_bench.suite import expand, run_suite, survey
    from sprl_bench.tables import tabulate
    from sprl_bench.tables.render import render
    from sprl_bench.tasks import SUITES, Suite, Task, find_suite
    from sprl_bench.video import record_video

__version__ = "0.1.0"
__all__ = [
    "SUITES",
    "RunRecord",
    "RunSpec",
    "Suite",
    "Task",
    "add_entry",
    "agent_names",
    "boards",
    "check_agent",
    "compare",
    "expand",
    "find_entries",
    "find_records",
    "find_suite",
    "make_entry",
    "make_executor",
    "plan_seeds",
    "plot",
    "record",
    "record_video",
    "recording",
    "render",
    "render_comparisons",
    "run_suite",
    "survey",
    "tabulate",
    "validate",
    "verify",
]

_HOMES = {
    "agents": "agent_names",
    "executors": "make_executor",
    "known_answers": "check_agent",
    "leaderboard": "add_entry boards compare find_entries make_entry plan_seeds render_comparisons validate",
    "plots": "plot",
    "recorder": "record recording",
    "records": "RunRecord RunSpec find_records",
    "replay": "verify",
    "suite": "expand run_suite survey",
    "tables": "render tabulate",
    "tasks": "SUITES Suite Task find_suite",
    "video": "record_video",
}
_HOME_OF = {name: f"sprl_bench.{home}" for home, names in _HOMES.items() for name in names.split()}


def __getattr__(name: str) -> Any:
    """Load a public name when it is first used."""
    if name not in _HOME_OF:
        raise AttributeError(f"module 'sprl_bench' has no attribute {name!r}")
    return getattr(importlib.import_module(_HOME_OF[name]), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})


register()
