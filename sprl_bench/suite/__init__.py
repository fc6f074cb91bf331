"""Many runs: from a suite, agents and seeds to specs, from specs to records, and the state of each run.

A run's state is in its folder alone, so any process or machine can work on it: finished runs are skipped, interrupted
ones continue, failed ones are tried again, and more can be added at any time.
"""

from __future__ import annotations

from sprl_bench.suite.devices import require_device
from sprl_bench.suite.execute import Observer, Outcome, run_suite
from sprl_bench.suite.plan import expand, hyperparameters_of, plainest
from sprl_bench.suite.short_budgets import too_short
from sprl_bench.suite.states import RunState, pace_of, state_of, survey

__all__ = [
    "Observer",
    "Outcome",
    "RunState",
    "expand",
    "hyperparameters_of",
    "pace_of",
    "plainest",
    "require_device",
    "run_suite",
    "state_of",
    "survey",
    "too_short",
]
