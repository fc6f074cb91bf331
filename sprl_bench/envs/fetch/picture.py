"""Pictures of a Fetch simulation, drawn from a copy, so that drawing never changes the simulation."""

from __future__ import annotations

import contextlib
import copy
import os
import sys
from collections.abc import Iterator
from typing import Any, Final

import mujoco
import numpy as np
from gymnasium.envs.mujoco.mujoco_rendering import MujocoRenderer
from gymnasium_robotics.envs.fetch.fetch_env import DEFAULT_CAMERA_CONFIG
from numpy.typing import NDArray

from sprl_bench.envs.fetch.simulation import STATE

_SIZE: Final = 480
_GOAL_MARK: Final = "target0"


class Picture:
    """Draws states of one model, with a red ball at the goal.

    Args:
        model: The model, which is copied.
    """

    def __init__(self, model: mujoco.MjModel) -> None:
        self._model = copy.copy(model)
        self._model.vis.global_.offwidth = self._model.vis.global_.offheight = _SIZE
        self._data = mujoco.MjData(self._model)
        self._renderer = MujocoRenderer(
            self._model, self._data, default_cam_config=DEFAULT_CAMERA_CONFIG, width=_SIZE, height=_SIZE
        )

    def draw(self, row: NDArray[np.float64], goal: NDArray[np.float64], render_mode: str) -> Any:
        """Return the picture of a saved state, uint8 [480, 480, 3], or show it in a window with `"human"`."""
        mujoco.mj_setState(self._model, self._data, row, STATE)
        mark = self._model.site(_GOAL_MARK)
        mark.pos[:] = goal - self._model.body(int(mark.bodyid[0])).pos
        mujoco.mj_forward(self._model, self._data)
        with _egl_without_a_display():
            return self._renderer.render(render_mode)

    def close(self) -> None:
        """Close the window and release the graphics context."""
        self._renderer.close()  # type: ignore[no-untyped-call]  # upstream is untyped


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
