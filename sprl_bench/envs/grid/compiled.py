"""How the grid kernels are compiled: by Numba, cached on disk under a name that all their sources decide.

Numba's own cache watches only the file that holds a kernel. Ours call functions of other files (the layouts are
shared with the single environment), and a kernel that outlives an edit of those would no longer be the same MDP.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final, TypeVar, cast

from numba import njit
from numba.extending import register_jitable

__all__ = ["SOURCES", "inline", "kernel"]

Function = TypeVar("Function", bound=Callable[..., Any])


def _digest(folder: Path) -> str:
    """Return a short hash of the Python sources in ``folder``."""
    sources = b"".join(path.read_bytes() for path in sorted(folder.glob("*.py")))
    return hashlib.sha256(sources).hexdigest()[:16]


SOURCES: Final = _digest(Path(__file__).parent)


def inline(function: Function) -> Function:
    """Let kernels call ``function``, which stays plain Python to everyone else."""
    return register_jitable(function)


def kernel(function: Function) -> Function:
    """Compile ``function`` to machine code that runs without the interpreter lock.

    The compiled code is cached on disk, or not at all where no folder can be written.
    """
    function.__qualname__ = f"{function.__qualname__}_{SOURCES}"
    try:
        compiled = njit(cache=True, nogil=True)(function)
    except RuntimeError:
        compiled = njit(nogil=True)(function)
    return cast(Function, compiled)
