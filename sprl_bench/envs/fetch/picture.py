"""Pictures of a Fetch simulation, drawn from a copy: drawing never touches what is simulated."""

from __future__ import annotations

import contextlib
import copy
import os
from collections.abc import Iterator
from typing import Any, Final

import mujoco
import numpy as np
from gymnasium.envs.mujoco.mujoco_rendering import MujocoRenderer
from gymnasium_robotics.envs.fetch.fetch_env import DEFAULT_CAMERA_CONFIG
from numpy.typing import NDArray

from sprl_bench.envs.fetch.simulation import STATE

__all__ = ["Picture"]

_SIZE: Final = 480
_GOAL_MARK: Final = "target0"


class Picture:
    """Draws states of one model, with a red ball at the goal.

    Args:
        model: The simulated model, which is copied.
    """

    def __init__(self, model: mujoco.MjModel) -> None:
        self._model = copy.copy(model)
        self._model.vis.global_.offwidth = self._model.vis.global_.offheight = _SIZE
        self._data = mujoco.MjData(self._model)
        self._has_context = False
        self._renderer = MujocoRenderer(
            self._model, self._data, default_cam_config=DEFAULT_CAMERA_CONFIG, width=_SIZE, height=_SIZE
        )

    def draw(self, row: NDArray[np.float64], goal: NDArray[np.float64], render_mode: str) -> Any:
        """Return the picture of a saved state, uint8 [480, 480, 3], or show it in a window under ``"human"``."""
        mujoco.mj_setState(self._model, self._data, row, STATE)
        mark = self._model.site(_GOAL_MARK)
        mark.pos[:] = goal - self._model.body(int(mark.bodyid[0])).pos
        mujoco.mj_forward(self._model, self._data)
        if not self._has_context and _has_no_choice():
            with contextlib.suppress(Exception), _egl_chosen():  # if it fails, whatever else there is gets its turn
                self._renderer.render(render_mode)
        picture = self._renderer.render(render_mode)
        self._has_context = True
        return picture

    def close(self) -> None:
        """Close the window and release the graphics context."""
        self._renderer.close()  # type: ignore[no-untyped-call]  # upstream is untyped


def _has_no_choice() -> bool:
    """Return whether there is no display, and nobody has said what else to draw with."""
    return not any(os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY", "MUJOCO_GL"))


@contextlib.contextmanager
def _egl_chosen() -> Iterator[None]:
    """Spare a headless machine MuJoCo's first choice, GLFW, which fails there, and noisily.

    The choice is taken back at once: where there is no EGL, a process that inherited it could not load MuJoCo.
    """
    os.environ["MUJOCO_GL"] = "egl"
    try:
        yield
    finally:
        del os.environ["MUJOCO_GL"]
