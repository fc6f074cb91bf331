"""How the harness makes environments: batched where we have an engine, always reset within the step that ends."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from gymnasium.envs.registration import make_vec
from gymnasium.vector import AutoresetMode, VectorEnv

__all__ = ["NAMESPACE", "make_envs"]

NAMESPACE = "SPRL/"


def make_envs(
    env_id: str, num_envs: int, arguments: Mapping[str, Any], num_threads: int = 1
) -> VectorEnv[Any, Any, Any]:
    """Make a vector environment in SameStep mode; a batched one uses so many threads at most.

    `make_vec` is taken from its own module: inside `recording()` the one in `gymnasium` records.
    """
    if env_id.startswith(NAMESPACE):
        return make_vec(env_id, num_envs=num_envs, num_threads=num_threads, **arguments)
    mode = {"autoreset_mode": AutoresetMode.SAME_STEP}
    return make_vec(env_id, num_envs=num_envs, vectorization_mode="sync", vector_kwargs=mode, **arguments)
