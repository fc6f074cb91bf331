"""How the kernels of the learner are compiled: sums may be taken in any order, the same one every time."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, Final, TypeVar

import numpy as np
from numpy.typing import NDArray

from sprl_bench.numba_cache import compile_cached

Array = NDArray[np.float32]
Arrays = tuple[Array, ...]
Offsets = NDArray[np.int64]
Function = TypeVar("Function", bound=Callable[..., Any])

FAST_MATH: Final = {"contract", "nsz", "reassoc"}


def kernel(function: Function) -> Function:
    """Compile `function`; it is made of the sources in this folder."""
    return compile_cached(function, Path(__file__).parent, error_model="numpy", fastmath=FAST_MATH)
