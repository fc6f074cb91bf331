"""Draw the picture of the Fetch tasks in the README: `python docs/draw_fetch.py docs/fetch.png`."""

from __future__ import annotations

import sys

import gymnasium
import matplotlib as mpl

import sprl_bench

mpl.use("Agg")
from matplotlib import pyplot

IDS = [f"SPRL/Fetch{task}Sparse-v1" for task in ("Reach", "Push", "Slide", "PickAndPlace")]
SEED = 3
ROWS, COLUMNS = slice(90, 410), slice(60, 380)  # the arm and the table


def main(path: str) -> None:
    """Render the first state of seed 3 of each task, side by side."""
    gymnasium.register_envs(sprl_bench)
    figure, panels = pyplot.subplots(1, len(IDS), figsize=(12, 3.3), layout="constrained")
    for panel, env_id in zip(panels, IDS, strict=True):
        env = gymnasium.make(env_id, render_mode="rgb_array")
        env.reset(seed=SEED)
        panel.imshow(env.render()[ROWS, COLUMNS])
        panel.set_title(env_id.removeprefix("SPRL/").removesuffix("-v1"), fontsize=11)
        panel.set_axis_off()
        env.close()
    figure.savefig(path, dpi=110)


if __name__ == "__main__":
    main(sys.argv[1])
