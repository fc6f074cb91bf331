"""Pictures of the Fetch tasks: they show the state and the goal, and never change either.

They are drawn through EGL in software (Debian: libegl1 libegl-mesa0 libgl1-mesa-dri); the window is opened on a
virtual screen (xvfb).
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from typing import Any

import gymnasium
import numpy as np
import pytest

import sprl_bench.envs

pytest.importorskip("mujoco")
pytest.importorskip("gymnasium_robotics")
sprl_bench.envs.register()

TASKS = ("Reach", "Push", "Slide", "PickAndPlace")
ON_CI = "CI" in os.environ


@pytest.fixture(autouse=True)
def software_rendering(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MUJOCO_GL", os.environ.get("MUJOCO_GL", "egl"))


def make(task: str, **arguments: Any) -> gymnasium.Env:
    return gymnasium.make(f"SPRL/Fetch{task}Sparse-v1", render_mode="rgb_array", **arguments)


def red(picture: np.ndarray) -> np.ndarray:
    """Return the rows and columns where the picture is as red as the ball at the goal, [n, 2]."""
    colours = picture.astype(int)
    return np.argwhere((colours[..., 0] > 120) & (colours[..., 1] < 60) & (colours[..., 2] < 60))


@pytest.mark.parametrize("task", TASKS)
def test_a_picture_shows_the_arm_and_the_goal(task: str) -> None:
    env = make(task)
    env.reset(seed=0)
    picture = env.render()
    assert (picture.shape, picture.dtype) == ((480, 480, 3), np.uint8)
    assert len(np.unique(picture.reshape(-1, 3), axis=0)) > 100
    before = red(picture).mean(axis=0)
    env.unwrapped.simulation.goal += [0.0, 0.1, 0.0]
    after = red(env.render()).mean(axis=0)
    assert after[1] - before[1] > 5  # the camera looks along x: y points right
    for _ in range(5):
        env.step(np.ones(4))
    assert (env.render() != picture).any(axis=2).mean() > 0.01
    env.close()


@pytest.mark.parametrize("task", TASKS)
def test_rendering_never_shifts_a_trajectory(task: str) -> None:
    """Upstream's rendering computes positions anew, and so moves PickAndPlace's next action."""
    seen, unseen = make(task, substep=3), make(task, substep=3)
    assert np.array_equal(seen.reset(seed=1)[0], unseen.reset(seed=1)[0])
    for action in np.random.default_rng(0).uniform(-1, 1, (15, 4)):
        seen.render()
        assert np.array_equal(seen.step(action)[0], unseen.step(action)[0])
    seen.close()


def test_an_engine_draws_what_the_single_environments_draw() -> None:
    envs = gymnasium.make_vec("SPRL/FetchPickAndPlaceSparse-v1", 2, render_mode="rgb_array", substep=8)
    twin = gymnasium.make_vec("SPRL/FetchPickAndPlaceSparse-v1", 2, substep=8)
    single = make("PickAndPlace", substep=8)
    envs.reset(seed=3)
    twin.reset(seed=3)
    single.reset(seed=4)
    for action in np.random.default_rng(0).uniform(-1, 1, (4, 2, 4)):
        assert np.array_equal(envs.step(action)[0], twin.step(action)[0])
        single.step(action[1])
        assert np.array_equal(envs.render()[1], single.render())
    envs.close()
    single.close()


def test_without_a_display_pictures_are_drawn_quietly() -> None:
    code = (
        "import gymnasium, sprl_bench; env = gymnasium.make('SPRL/FetchReachSparse-v1', render_mode='rgb_array');"
        "env.reset(seed=0); print(env.render().shape); env.close();"
        "import os; print(os.environ.get('MUJOCO_GL'), os.environ.get('PYOPENGL_PLATFORM'))"
    )
    unwanted = ("DISPLAY", "WAYLAND_DISPLAY", "MUJOCO_GL", "PYOPENGL_PLATFORM")
    environment = {name: value for name, value in os.environ.items() if name not in unwanted}
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=environment, check=True)
    assert done.stdout.split("\n")[:2] == ["(480, 480, 3)", "None None"]
    assert "Traceback" not in done.stderr


def test_a_machine_that_cannot_draw_keeps_its_environment_as_it_was(monkeypatch: pytest.MonkeyPatch) -> None:
    """Else no process that it starts could load MuJoCo, which looks for what the variable names."""
    from gymnasium.envs.mujoco import mujoco_rendering

    tried: list[str | None] = []

    def render(*_: Any) -> None:
        tried.append(os.environ.get("MUJOCO_GL"))
        raise RuntimeError("no context")

    for name in ("DISPLAY", "WAYLAND_DISPLAY", "MUJOCO_GL"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(mujoco_rendering.MujocoRenderer, "render", render)
    env = make("Reach")
    env.reset(seed=0)
    with pytest.raises(RuntimeError, match="no context"):
        env.render()
    assert tried == ["egl"]
    assert "MUJOCO_GL" not in os.environ


@pytest.mark.skipif(shutil.which("xvfb-run") is None and not ON_CI, reason="needs xvfb")
def test_the_window_opens_and_closes_on_a_virtual_screen() -> None:
    code = (
        "import gymnasium, sprl_bench;"
        "env = gymnasium.make('SPRL/FetchReachSparse-v1', render_mode='human'); env.reset(seed=0);"
        "env.action_space.seed(0);"
        "print([env.step(env.action_space.sample())[1] for _ in range(3)], env.render()); env.close()"
    )
    environment = {name: value for name, value in os.environ.items() if name != "MUJOCO_GL"}
    command = ["xvfb-run", "-a", sys.executable, "-W", "error", "-c", code]
    done = subprocess.run(command, capture_output=True, text=True, env=environment, check=False, timeout=120)
    assert done.returncode == 0, done.stderr
    assert done.stdout.split("\n")[0] == "[0.0, 0.0, 0.0] None"


def test_a_video_is_recorded(tmp_path: Any) -> None:
    pytest.importorskip("moviepy")
    env = gymnasium.wrappers.RecordVideo(make("Reach", substep=250), str(tmp_path / "new"), disable_logger=True)
    env.reset(seed=0)
    while not any(env.step(np.zeros(4))[2:4]):
        pass
    env.close()
    assert len(list(tmp_path.glob("new/*.mp4"))) == 1
