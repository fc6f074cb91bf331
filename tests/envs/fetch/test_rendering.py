"""Pictures of the Fetch tasks: they show the state and the goal, and never change either.

They are drawn through EGL in software (Debian: libegl1 libegl-mesa0 libgl1-mesa-dri); the window is opened on a
virtual screen (xvfb).
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from ctypes.util import find_library
from pathlib import Path
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


# --------------------------------------------------------------------------- several pictures in one process


def test_closing_one_environment_leaves_the_pictures_of_others() -> None:
    one, other, third = (make(task) for task in ("Reach", "Reach", "Push"))
    for env in (one, other, third):
        env.reset(seed=0)
    before = other.render()
    assert np.array_equal(one.render(), before)
    pushed = third.render()
    one.close()
    assert np.array_equal(other.render(), before)
    third.close()
    assert np.array_equal(other.render(), before)
    again = make("Push")
    again.reset(seed=0)
    assert np.array_equal(again.render(), pushed)
    assert np.array_equal(other.render(), before)
    again.close()
    other.close()


def test_another_thread_draws_the_same() -> None:
    env = make("Reach")
    env.reset(seed=0)
    before = env.render()
    with ThreadPoolExecutor(2) as threads:
        drawn = [threads.submit(env.render).result() for _ in range(4)]
    assert all(np.array_equal(picture, before) for picture in [*drawn, env.render()])
    env.close()


def test_a_closed_environment_draws_again_after_a_reset() -> None:
    env = make("Reach")
    env.reset(seed=0)
    before = env.render()
    env.close()
    env.reset(seed=0)
    assert np.array_equal(env.render(), before)
    env.close()


def printed(code: str, **changes: str | None) -> subprocess.CompletedProcess[str]:
    """Run a script in a process of its own; None removes a variable of the environment."""
    variables = {**os.environ, **changes}
    environment = {name: value for name, value in variables.items() if value is not None}
    command = [sys.executable, "-W", "ignore", "-c", "import gymnasium, sprl_bench\n" + code]
    return subprocess.run(command, capture_output=True, text=True, env=environment, check=False, timeout=120)


def test_an_open_picture_does_not_disturb_the_end_of_the_process() -> None:
    code = (
        "envs = [gymnasium.make('SPRL/FetchReachSparse-v1', render_mode='rgb_array') for _ in range(2)]\n"
        "for env in envs: env.reset(seed=0); env.render()\n"
    )
    done = printed(code)
    assert done.returncode == 0
    assert "Traceback" not in done.stderr
    assert "Exception ignored" not in done.stderr


@pytest.mark.parametrize("display", [None, ":77", "nowhere:1"])
def test_a_window_without_a_display_is_an_error_that_loses_nothing(display: str | None, tmp_path: Path) -> None:
    code = f"""
env = sprl_bench.record(gymnasium.make("SPRL/FourRooms-7x7-v1"), out={str(tmp_path)!r}, agent="mine", seed=0)
env.reset(seed=0)
for _ in range(50): env.step(0)
gymnasium.make("SPRL/FetchReachSparse-v1", render_mode="human").reset()
"""
    done = printed(code, DISPLAY=display, WAYLAND_DISPLAY=None, MUJOCO_GL=None)
    assert done.returncode == 1
    assert "NoPictureError: render_mode is 'human', but there is no display; it must be 'rgb_array'" in done.stderr
    [record] = sprl_bench.find_records(tmp_path)
    assert (record.status, record.totals.env_steps) == ("incomplete", 50)


DRAWN = """
env = gymnasium.make("SPRL/FetchReachSparse-v1", render_mode="rgb_array")
env.reset(seed=0)
print(env.render().shape)
"""


@pytest.mark.parametrize(
    ("chosen", "error"),
    [
        pytest.param(
            "osmesa", "ImportError", marks=pytest.mark.skipif(bool(find_library("OSMesa")), reason="there is OSMesa")
        ),
        ("glfw", "sprl_bench.envs.graphics.NoPictureError"),
        ("EGL", "sprl_bench.envs.graphics.NoPictureError"),
        ("evil", "ImportError"),
    ],
)
def test_chosen_graphics_that_do_not_work_are_named(chosen: str, error: str) -> None:
    done = printed(DRAWN, DISPLAY=None, WAYLAND_DISPLAY=None, PYOPENGL_PLATFORM=None, MUJOCO_GL=chosen)
    assert done.returncode == 1
    [line] = [one for one in done.stderr.splitlines() if one.startswith(f"{error}: MUJOCO_GL is")]
    assert f"MUJOCO_GL is {chosen!r}, which does not work here" in line
    assert "it must be egl with its library (Debian: libegl1), osmesa with its library" in line
    assert line.endswith("or glfw with a display.")


FORKED = """
import multiprocessing, os
from gymnasium.vector import AsyncVectorEnv
def made():
    env = gymnasium.make("SPRL/FetchReachSparse-v1", render_mode="rgb_array")
    env.reset(seed=0)
    return env
env = made()
if DRAWS: env.render()
def draw():
    try:
        print(made().render().shape, flush=True)
    except RuntimeError as error:
        print(error, flush=True)
"""


BY_FORK = "os._exit(draw() or 0) if os.fork() == 0 else os.wait()"
BY_PROCESS = "child = multiprocessing.get_context('fork').Process(target=draw); child.start(); child.join()"
BY_VECTOR = "try: AsyncVectorEnv([made], context='fork').render()\nexcept Exception as error: print(error)"


@pytest.mark.parametrize(
    ("draws", "how", "expected"),
    [
        (True, BY_PROCESS, "refused"),
        (True, BY_FORK, "refused"),
        (False, BY_FORK, "(480, 480, 3)"),
        (True, BY_VECTOR, "refused"),
    ],
)
def test_a_forked_process_does_not_hang(draws: bool, how: str, expected: str) -> None:
    done = printed(FORKED.replace("DRAWS", str(draws)) + how)
    wanted = "This process was forked from one that has drawn pictures" if expected == "refused" else expected
    assert wanted in done.stdout, done.stderr
