"""The four sparse Fetch tasks: single environments on Gymnasium-Robotics, and a batched engine on MuJoCo's batch."""

from __future__ import annotations

from importlib.util import find_spec

if find_spec("mujoco") is None or find_spec("gymnasium_robotics") is None:
    raise ImportError("The Fetch tasks need mujoco and gymnasium-robotics: pip install 'sprl-bench[fetch]'.")
