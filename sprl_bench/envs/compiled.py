"""How the grid kernels are compiled: by Numba, cached on disk under a name that all their sources decide.

Numba's own cache watches only the file that holds a kernel. Ours call functions of other files (the layouts are
shared with the single environment, the maps with the solver's search), and a kernel that outlives an edit of those
would no longer be the same MDP.
"""

from __future__ import annotations

import hashlib
import inspect
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, TypeVar, cast

from numba import njit
from numba.extending import register_jitable

Function = TypeVar("Function", bound=Callable[..., Any])


@cache
def sources(folder: Path) -> str:
    """Return a short hash of the Python sources in ``folder``, beside this file, and in the folder of the grids."""
    here = Path(__file__).parent
    paths = {path for each in (here, here / "grid", folder) for path in each.glob("*.py")}
    return hashlib.sha256(b"".join(path.read_bytes() for path in sorted(paths))).hexdigest()[:16]


def inline(function: Function) -> Function:
    """Let kernels call ``function``, which stays plain Python to everyone else."""
    return register_jitable(function)


def kernel(function: Function) -> Function:
    """Compile ``function`` to machine code that runs without the interpreter lock.

    The compiled code is cached on disk, or not at all where no folder can be written.
    """
    folder = Path(inspect.getfile(function)).parent
    function.__qualname__ = f"{function.__qualname__}_{sources(folder)}"
    try:
        compiled = njit(cache=True, nogil=True)(function)
    except RuntimeError:
        compiled = njit(nogil=True)(function)
    return cast(Function, compiled)
