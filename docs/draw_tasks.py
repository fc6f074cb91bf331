"""Draw a picture of tasks in the README: `python docs/draw_tasks.py grids docs/grids.png`, or fetch."""

from __future__ import annotations

import sys

import gymnasium
import matplotlib as mpl

import sprl_bench

mpl.use("Agg")
from matplotlib import pyplot

IDS = {
    "grids": [f"SPRL/{task}-v1" for task in ("FourRooms-7x7", "FourRooms-11x11", "KeyDoors-7x7", "KeyDoors-11x11")],
    "fetch": [f"SPRL/Fetch{task}Sparse-v1" for task in ("Reach", "Push", "Slide", "PickAndPlace")],
}
CROPS = {
    "grids": (slice(None), slice(None)),
    "fetch": (slice(90, 410), slice(60, 380)),  # the arm and the table
}
SEED = 3


def main(family: str, path: str) -> None:
    """Render the first state of seed 3 of each task of a family, side by side."""
    gymnasium.register_envs(sprl_bench)
    figure, panels = pyplot.subplots(1, len(IDS[family]), figsize=(12, 3.3), layout="constrained")
    for panel, env_id in zip(panels, IDS[family], strict=True):
        env = gymnasium.make(env_id, render_mode="rgb_array")
        env.reset(seed=SEED)
        panel.imshow(env.render()[CROPS[family]], interpolation="nearest")
        panel.set_title(env_id.removeprefix("SPRL/").removesuffix("-v1"), fontsize=11)
        panel.set_axis_off()
        env.close()
    figure.savefig(path, dpi=110)


if __name__ == "__main__":
    main(*sys.argv[1:])
