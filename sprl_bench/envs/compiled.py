"""Compilation of the grid kernels with Numba, cached on disk under a name that contains a hash of all their sources.

Numba's own cache only notices changes of the file that holds a kernel. Our kernels call functions of other files (the
layouts are shared with the single environment, the maps with the solver's search). After an edit of those, a cached
kernel would be a different MDP.
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
    """Return a short hash of the Python sources in `folder`, beside this file, and in the folder of the grids."""
    here = Path(__file__).parent
    paths = {path for each in (here, here / "grid", folder) for path in each.glob("*.py")}
    return hashlib.sha256(b"".join(path.read_bytes() for path in sorted(paths))).hexdigest()[:16]


def inline(function: Function) -> Function:
    """Let kernels call `function`, which remains a plain Python function elsewhere."""
    return register_jitable(function)


def kernel(function: Function) -> Function:
    """Compile `function` to machine code that runs without the interpreter lock.

    The compiled code is cached on disk if a folder is writable.
    """
    folder = Path(inspect.getfile(function)).parent
    function.__qualname__ = f"{function.__qualname__}_{sources(folder)}"
    try:
        compiled = njit(cache=True, nogil=True)(function)
    except RuntimeError:
        compiled = njit(nogil=True)(function)
    return cast(Function, compiled)
