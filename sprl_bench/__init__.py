"""sprl-bench: the benchmark for sparse-reward reinforcement learning.

Importing this package registers its environments with Gymnasium; everything else is loaded when it is first used.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from sprl_bench.envs import register

if TYPE_CHECKING:
    from sprl_bench.recorder import record, recording

__version__ = "0.1.0"
__all__ = ["__version__", "record", "recording"]

_HOMES = {"record": "sprl_bench.recorder", "recording": "sprl_bench.recorder"}


def __getattr__(name: str) -> Any:
    """Load a public name from its home when it is first asked for."""
    if name not in _HOMES:
        raise AttributeError(f"module 'sprl_bench' has no attribute {name!r}")
    return getattr(importlib.import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *_HOMES})


register()
