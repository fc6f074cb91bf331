"""Compilation with Numba, cached on disk under a name that contains a hash of all sources.

Numba's own cache only notices changes of the file that holds a function. Ours call functions of other files: after an
edit of those, a cached function would compute something else.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, TypeVar, cast

from numba import njit

Function = TypeVar("Function", bound=Callable[..., Any])


@cache
def sources(*folders: Path) -> str:
    """Return a short hash of the Python sources in these folders."""
    paths = {path for folder in folders for path in folder.glob("*.py")}
    return hashlib.sha256(b"".join(path.read_bytes() for path in sorted(paths))).hexdigest()[:16]


def compile_cached(function: Function, *folders: Path, **options: Any) -> Function:
    """Compile `function` to machine code that runs without the interpreter lock.

    The compiled code is cached on disk if a folder is writable.

    Args:
        function: What to compile.
        folders: Those with the sources that the function is made of.
        options: More options of `numba.njit`.
    """
    function.__qualname__ = f"{function.__qualname__}_{sources(*folders)}"
    try:
        compiled = njit(cache=True, nogil=True, **options)(function)
    except RuntimeError:
        compiled = njit(nogil=True, **options)(function)
    return cast(Function, compiled)
