"""Many runs: from a suite, agents and seeds to specs, from specs to records, and what is left to do.

All that is known about a run lies in its folder, so it does not matter which process or machine works on it: what is
finished is skipped, what was interrupted goes on, what failed is tried again, and more can be added at any time.
"""

from __future__ import annotations

from sprl_bench.suite.devices import require_device
from sprl_bench.suite.execute import Observer, Outcome, run_suite
from sprl_bench.suite.plan import expand
from sprl_bench.suite.states import RunState, state_of, survey

__all__ = ["Observer", "Outcome", "RunState", "expand", "require_device", "run_suite", "state_of", "survey"]
