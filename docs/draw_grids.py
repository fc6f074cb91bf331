"""Draw the picture of the grid tasks in the README: `python docs/draw_grids.py docs/grids.png`."""

from __future__ import annotations

import sys

import gymnasium
import matplotlib as mpl

import sprl_bench

mpl.use("Agg")
from matplotlib import pyplot

IDS = ["SPRL/FourRooms-7x7-v1", "SPRL/FourRooms-11x11-v1", "SPRL/KeyDoors-7x7-v1", "SPRL/KeyDoors-11x11-v1"]
SEED = 3


def main(path: str) -> None:
    """Render the first state of seed 3 of each grid, side by side."""
    gymnasium.register_envs(sprl_bench)
    figure, panels = pyplot.subplots(1, len(IDS), figsize=(12, 3.3), layout="constrained")
    for panel, env_id in zip(panels, IDS, strict=True):
        env = gymnasium.make(env_id, render_mode="rgb_array")
        env.reset(seed=SEED)
        panel.imshow(env.render(), interpolation="nearest")
        panel.set_title(env_id.removeprefix("SPRL/").removesuffix("-v1"), fontsize=11)
        panel.set_axis_off()
        env.close()
    figure.savefig(path, dpi=110)


if __name__ == "__main__":
    main(sys.argv[1])
