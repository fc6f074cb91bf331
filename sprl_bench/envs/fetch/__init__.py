"""The four sparse Fetch tasks: single environments on Gymnasium-Robotics, and a batched engine on MuJoCo's batch."""

from __future__ import annotations

from importlib.util import find_spec

from sprl_bench.extras import EXTRAS, not_installed

for _module in EXTRAS["fetch"].modules:
    if find_spec(_module) is None:
        raise ImportError(f"The Fetch tasks need {_module}: {not_installed(_module)}.")
