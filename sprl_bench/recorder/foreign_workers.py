"""Libraries that start a process for each environment: a recording block cannot see in there, so it refuses them."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from multiprocessing.process import BaseProcess
from typing import Final

WORKERS: Final = (
    "pufferlib.vector",
    "sb3_contrib.common.vec_env",
    "stable_baselines3.common.vec_env",
    "tianshou.env",
    "torchrl.collectors",
    "torchrl.envs",
)
"""The modules with the functions that such a process runs."""


@contextlib.contextmanager
def refusing_workers(paused: Callable[[], bool]) -> Iterator[None]:
    """Refuse, unless paused, to start a process for environments of another library."""
    start = BaseProcess.start

    def start_unless_foreign(process: BaseProcess) -> None:
        """Start a process, or refuse one that another library starts for its environments."""
        module = getattr(getattr(process, "_target", None), "__module__", None) or ""
        if module.startswith(WORKERS) and not paused():
            raise RuntimeError(
                f"{module} starts processes for environments, and recording() cannot record there. Make the "
                "environments in this process; in Stable-Baselines3, use DummyVecEnv, in Tianshou DummyVectorEnv, in "
                "TorchRL SerialEnv. Make those for evaluation under `with recording.paused():`."
            )
        start(process)

    BaseProcess.start = start_unless_foreign  # type: ignore[method-assign, assignment] # it names self otherwise
    try:
        yield
    finally:
        BaseProcess.start = start  # type: ignore[method-assign]
