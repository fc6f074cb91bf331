"""Compilation with Numba, cached on disk under a name that contains a hash of all sources.

Numba's own cache only notices changes of the file that holds a function. Ours call functions of other files: after an
edit of those, a cached function would compute something else.
"""

from __future__ import annotations

import contextlib
import hashlib
import logging
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, TypeVar, cast

from numba import njit

logger = logging.getLogger("sprl_bench")

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
    else:
        compiled._cache = OptionalCache(compiled._cache)
    return cast(Function, compiled)


class OptionalCache:
    """Numba's cache on disk, without which a function is compiled: a full disk or a broken file stops nothing."""

    def __init__(self, cache: Any) -> None:
        self._cache = cache

    def load_overload(self, *arguments: Any) -> Any:
        """Return a compiled function; None if there is none, or if its file is broken."""
        try:
            return self._cache.load_overload(*arguments)
        except Exception as error:  # whatever a broken file makes of the reading
            self._warn("read", error)
            with contextlib.suppress(Exception):
                self._cache.flush()  # so that what is compiled now can be kept
            return None

    def save_overload(self, *arguments: Any) -> None:
        """Keep a compiled function, if that is possible."""
        try:
            self._cache.save_overload(*arguments)
        except Exception as error:  # as above
            self._warn("written", error)

    def _warn(self, done: str, error: Exception) -> None:
        logger.warning(
            "Numba's cache in %s cannot be %s (%s: %s); functions are compiled anew.",
            *(self._cache.cache_path, done, type(error).__name__, error),
        )

    def __getattr__(self, name: str) -> Any:
        return getattr(self._cache, name)
