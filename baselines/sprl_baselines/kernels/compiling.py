"""How kernels are compiled: to machine code for this processor, kept on disk where a folder can be written."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final, TypeVar, cast

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float32]
Arrays = tuple[Array, ...]
Offsets = NDArray[np.int64]
F = TypeVar("F", bound=Callable[..., Any])

FAST_MATH: Final = {"contract", "nsz", "reassoc"}  # sums may be taken in any order, the same one every time


def kernel(function: F) -> F:
    """Compile to machine code, kept on disk where a folder can be written.

    Numba's cache watches the file of the function alone: after a change to `vectors`, delete what is cached.
    """
    try:
        return cast(F, njit(cache=True, nogil=True, error_model="numpy", fastmath=FAST_MATH)(function))
    except RuntimeError:
        return cast(F, njit(nogil=True, error_model="numpy", fastmath=FAST_MATH)(function))
