"""The four sparse Fetch tasks: single environments on Gymnasium-Robotics, and a batched engine on MuJoCo's batch."""

from __future__ import annotations

import contextlib
from importlib import import_module
from importlib.util import find_spec

from sprl_bench.envs.graphics import load_mujoco
from sprl_bench.extras import EXTRAS, not_installed

for _module in EXTRAS["fetch"].modules:
    if find_spec(_module) is None:
        raise ImportError(f"The Fetch tasks need {_module}: {not_installed(_module)}.")

load_mujoco()

# At its import Gymnasium-Robotics prints a notice about environments of the Adroit hand, which are none of these.
with contextlib.suppress(ImportError):
    import_module("farama_notifications").notifications.pop("gymnasium_robotics", None)
