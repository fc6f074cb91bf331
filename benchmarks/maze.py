"""The batched maze engine against ViZDoom, the usual engine of first-person tasks.

Both take uniformly random actions of four frames, restart what has ended, and return every picture. ViZDoom's smallest
picture has 160 x 120 pixels, 2.7 times as many as ours; most of its time is not drawing.
"""

from __future__ import annotations

import tempfile
from functools import partial
from pathlib import Path
from typing import Any, Final

import gymnasium
import numpy as np

import sprl_bench  # noqa: F401 - registers the ids
from benchmarks.contenders import contender, optional
from benchmarks.measure import Row, compare
from benchmarks.turns import Turn

TASK: Final = "SPRL/MazeGoalSmall-v1"
SCENARIO: Final = "my_way_home"  # rooms and a goal
FRAMES: Final = 4


def rows() -> list[Row]:
    """Measure all rows; takes a minute."""
    row = compare(
        "MazeGoalSmall, N=64, 1 thread",
        contender(ours, num_envs=64, steps=400),
        f"ViZDoom {SCENARIO}, 160x120, frame skip {FRAMES}, one process",
        optional("vizdoom", "vizdoom", doom, steps=2000),
        bar=5,
    )
    return [row]


def ours(num_envs: int, steps: int) -> Turn:
    """Return turns of our engine."""
    envs = gymnasium.make_vec(TASK, num_envs, num_threads=1)
    actions = list(np.random.default_rng(0).integers(9, size=(steps, num_envs)))
    envs.reset(seed=0)
    return partial(_run, envs, actions)


def _run(envs: Any, actions: list[np.ndarray[Any, Any]]) -> int:
    for action in actions:
        envs.step(action)
    return sum(map(len, actions))


def doom(steps: int) -> Turn:
    """Return turns of ViZDoom, without sound, a window and a second process."""
    import vizdoom  # noqa: PLC0415 - optional

    game = vizdoom.DoomGame()
    game.load_config(str(Path(vizdoom.scenarios_path) / f"{SCENARIO}.cfg"))
    game.set_doom_config_path(str(Path(tempfile.mkdtemp()) / "vizdoom.ini"))  # else it writes into this folder
    game.set_window_visible(False)
    game.set_screen_resolution(vizdoom.ScreenResolution.RES_160X120)
    game.set_screen_format(vizdoom.ScreenFormat.RGB24)
    game.init()
    choices = np.eye(game.get_available_buttons_size(), dtype=int).tolist()
    actions = [choices[index] for index in np.random.default_rng(0).integers(len(choices), size=steps)]
    return partial(_play, game, actions)


def _play(game: Any, actions: list[list[int]]) -> int:
    for action in actions:
        if game.is_episode_finished():
            game.new_episode()
        game.get_state()
        game.make_action(action, FRAMES)
    return len(actions)
