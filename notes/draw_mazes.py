"""Draw the mazes: `python notes/draw_mazes.py docs/mazes.png docs/maze.gif`."""

from __future__ import annotations

import sys
from typing import Any

import gymnasium
import imageio.v2
import numpy as np

import sprl_bench
from sprl_bench import solver
from sprl_bench.envs import MAZE_IDS

Picture = np.ndarray[Any, Any]

SEEDS = (4, 12, 6)
SHOWN = (41, 44, 28)  # steps until a thing is near
FILMED = 74


def film(env_id: str, seed: int, steps: int) -> list[Picture]:
    """Return what the solver sees, with the view from above: uint8 [168, 336, 3] for each step."""
    env: Any = gymnasium.make(env_id, render_mode="rgb_array")
    env.reset(seed=seed)
    pictures = [env.render()[::2, ::2]]
    for _ in range(steps):
        env.step(int(solver.maze_actions(env.unwrapped.mazes)[0]))
        pictures.append(env.render()[::2, ::2])
    return pictures


def main(picture: str, moving: str) -> None:
    """Draw all three side by side, and a film of the first at half the frames."""
    gymnasium.register_envs(sprl_bench)
    ends = [film(*maze)[-1] for maze in zip(MAZE_IDS, SEEDS, SHOWN, strict=True)]
    imageio.v2.imwrite(picture, np.hstack(ends))
    frames = film(MAZE_IDS[0], SEEDS[0], FILMED)[::2]
    imageio.v2.mimsave(moving, frames, duration=2000 / 15, loop=0, palettesize=32, subrectangles=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
