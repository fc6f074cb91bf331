"""Pictures of a Fetch simulation, drawn from a copy, so that drawing never changes the simulation.

OpenGL draws into the context that is current, one for each thread: that of another picture if that was drawn last, or
none if that was closed. So a picture's own context is made current for each drawing, and given back after it.
"""

from __future__ import annotations

import atexit
import contextlib
import copy
import functools
import os
import sys
import warnings
import weakref
from collections.abc import Iterator
from typing import Any, Final

import mujoco
import numpy as np
from gymnasium.envs.mujoco.mujoco_rendering import MujocoRenderer
from gymnasium_robotics.envs.fetch.fetch_env import DEFAULT_CAMERA_CONFIG
from numpy.typing import NDArray

from sprl_bench.envs.fetch.simulation import STATE
from sprl_bench.envs.graphics import NoPictureError, chosen_graphics

_SIZE: Final = 480
_GOAL_MARK: Final = "target0"
_OPEN: Final[weakref.WeakSet[Picture]] = weakref.WeakSet()
_DRAWN_BY: Final[set[int]] = set()  # the processes that have drawn: this one and those it was forked from


class Picture:
    """Draws states of one model, with a red ball at the goal.

    Args:
        model: The model, which is copied.
    """

    def __init__(self, model: mujoco.MjModel) -> None:
        self._model = copy.copy(model)
        self._model.vis.global_.offwidth = self._model.vis.global_.offheight = _SIZE
        self._data = mujoco.MjData(self._model)
        self._renderer: Any = MujocoRenderer(
            self._model, self._data, default_cam_config=DEFAULT_CAMERA_CONFIG, width=_SIZE, height=_SIZE
        )

    def draw(self, row: NDArray[np.float64], goal: NDArray[np.float64], render_mode: str) -> Any:
        """Return the picture of a saved state, uint8 [480, 480, 3], or show it in a window with `"human"`."""
        mujoco.mj_setState(self._model, self._data, row, STATE)
        mark = self._model.site(_GOAL_MARK)
        mark.pos[:] = goal - self._model.body(int(mark.bodyid[0])).pos
        mujoco.mj_forward(self._model, self._data)
        _refuse_forked()
        if render_mode == "human":
            _require_display()
        is_first = self._renderer.viewer is None and render_mode != "human"
        with chosen_graphics() if is_first else contextlib.nullcontext(), _egl_without_a_display():
            try:
                self._make_current()
                return self._renderer.render(render_mode)
            finally:
                self._note()

    def driver(self) -> str:
        """Return the name of the driver that draws; a picture must have been drawn."""
        from OpenGL import GL  # noqa: PLC0415 - loaded by MuJoCo's renderer

        self._make_current()
        try:
            return bytes(GL.glGetString(GL.GL_RENDERER)).decode()
        finally:
            self._note()

    def _make_current(self) -> None:
        if self._renderer.viewer is not None:
            self._renderer.viewer.make_context_current()

    def _note(self) -> None:
        """Give the context back, so that any thread can draw next, and see to it that it is released at the end."""
        if self._renderer.viewer is not None:
            _DRAWN_BY.add(os.getpid())
            _OPEN.add(self)
            _close_all_at_exit()
            _give_back(self._renderer.viewer)

    def close(self) -> None:
        """Close the window and release the graphics context; those of other pictures stay."""
        viewer = self._renderer.viewer
        _OPEN.discard(self)
        if viewer is None or os.getpid() not in _DRAWN_BY:
            return
        viewer.make_context_current()
        viewer.con.free()
        viewer.free()
        self._renderer.viewer = None
        self._renderer._viewers.clear()


def drivers() -> set[str]:
    """Return the names of the drivers that have drawn the pictures which are still open."""
    return {picture.driver() for picture in _OPEN}


def _give_back(viewer: Any) -> None:
    """Let no context be current in this thread."""
    backend = getattr(viewer, "backend", "glfw")
    if backend == "egl":
        from mujoco import egl  # noqa: PLC0415 - there is no EGL on every machine

        egl.EGL.eglMakeCurrent(egl.EGL_DISPLAY, *[egl.EGL.EGL_NO_SURFACE] * 2, egl.EGL.EGL_NO_CONTEXT)
    elif backend == "glfw":
        import glfw  # noqa: PLC0415 - needed with a display only

        glfw.make_context_current(None)  # type: ignore[arg-type] # its stub knows no null


@functools.cache
def _close_all_at_exit() -> None:
    """Release all contexts before the libraries that made them; what is registered last is called first."""
    atexit.register(_close_all)


def _close_all() -> None:
    for picture in list(_OPEN):
        picture.close()


def _refuse_forked() -> None:
    """Refuse to draw where OpenGL would wait for ever: in a process that was forked after a drawing.

    Raises:
        NoPictureError: This is such a process.
    """
    if _DRAWN_BY and os.getpid() not in _DRAWN_BY:
        raise NoPictureError(
            "This process was forked from one that has drawn pictures, which OpenGL does not survive; it must be "
            'spawned, as by AsyncVectorEnv(..., context="spawn"), or only one of the two may draw.'
        )


def _require_display() -> None:
    """Refuse to open a window where there is no screen; GLFW would end the process.

    Raises:
        NoPictureError: There is no screen.
    """
    import glfw  # noqa: PLC0415 - needed for windows only

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the error says all
        there = glfw.init() and glfw.get_primary_monitor()
    if not there:
        raise NoPictureError(
            "render_mode is 'human', but there is no display; it must be 'rgb_array', or a display must be named by "
            "DISPLAY, as `xvfb-run` does."
        )


@contextlib.contextmanager
def _egl_without_a_display() -> Iterator[None]:
    """Choose EGL on a headless Linux machine, where MuJoCo's first choice, GLFW, fails.

    The environment variables are restored afterwards: without EGL, a child process that inherits them cannot load
    MuJoCo.
    """
    chosen = ("DISPLAY", "WAYLAND_DISPLAY", "MUJOCO_GL")
    if sys.platform != "linux" or any(os.environ.get(name) for name in chosen):
        yield
        return
    before = {name: os.environ.get(name) for name in ("MUJOCO_GL", "PYOPENGL_PLATFORM")}
    os.environ["MUJOCO_GL"] = "egl"
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value
