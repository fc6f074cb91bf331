"""The graphics that `MUJOCO_GL` chooses, and one sentence where they do not work."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator
from importlib import import_module
from typing import Final

BACKENDS: Final = ("egl", "glfw", "osmesa")


class NoPictureError(RuntimeError):
    """There is no display, or no OpenGL that works in this process."""


def load_mujoco() -> None:
    """Import MuJoCo, which loads the library of the graphics that are chosen, even if nothing is drawn.

    Raises:
        ImportError: That library cannot be loaded, or there are no such graphics.
    """
    try:
        import_module("mujoco")
    except Exception as error:  # PyOpenGL raises whatever its missing library leads to
        if not os.environ.get("MUJOCO_GL"):
            raise
        raise ImportError(_sentence(error)) from error


@contextlib.contextmanager
def chosen_graphics() -> Iterator[None]:
    """Say what is wrong with the graphics that are chosen, if the first drawing fails.

    Raises:
        NoPictureError: They do not work here.
    """
    chosen = os.environ.get("MUJOCO_GL")
    if chosen and chosen not in BACKENDS:
        raise NoPictureError(_sentence())
    try:
        yield
    except Exception as error:  # MuJoCo, GLFW and PyOpenGL have no common one
        if not chosen:
            raise
        raise NoPictureError(_sentence(error)) from error


def _sentence(error: Exception | None = None) -> str:
    cause = f" ({type(error).__name__}: {' '.join(str(error).split())})" if error else ""
    return (
        f"MUJOCO_GL is {os.environ.get('MUJOCO_GL')!r}, which does not work here{cause}; it must be egl with its "
        "library (Debian: libegl1), osmesa with its library (Debian: libosmesa6), or glfw with a display."
    )
