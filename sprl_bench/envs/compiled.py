"""How the kernels of grids, mazes and the solver are compiled."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

from numba.extending import register_jitable

from sprl_bench.numba_cache import compile_cached

Function = TypeVar("Function", bound=Callable[..., Any])

HERE = Path(__file__).parent


def inline(function: Function) -> Function:
    """Let kernels call `function`, which remains a plain Python function elsewhere."""
    return register_jitable(function)


def kernel(function: Function) -> Function:
    """Compile `function`; it is made of the sources beside it and this file, and in the folders of grids and mazes."""
    return compile_cached(function, HERE, HERE / "grid", HERE / "maze", Path(inspect.getfile(function)).parent)
