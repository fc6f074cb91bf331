"""Draw the pictures of the tasks: `python notes/draw_tasks.py grids docs/grids.png`, `... fetch docs/fetch.png`."""

from __future__ import annotations

import sys

import gymnasium
import matplotlib as mpl

import sprl_bench

mpl.use("Agg")
from matplotlib import pyplot

GRIDS = [f"SPRL/{task}-v1" for task in ("FourRooms-7x7", "FourRooms-11x11", "KeyDoors-7x7", "KeyDoors-11x11")]
FETCH = [f"SPRL/Fetch{task}Sparse-v1" for task in ("Reach", "Push", "Slide", "PickAndPlace")]
ARM_AND_TABLE = slice(90, 410), slice(60, 380)
FAMILIES = {"grids": (GRIDS, (), "nearest"), "fetch": (FETCH, ARM_AND_TABLE, None)}  # ids, what is cut out, how drawn
SEED = 3


def main(family: str, path: str) -> None:
    """Render the first state of seed 3 of each task of a family, side by side."""
    gymnasium.register_envs(sprl_bench)
    ids, crop, interpolation = FAMILIES[family]
    figure, panels = pyplot.subplots(1, len(ids), figsize=(12, 3.3), layout="constrained")
    for panel, env_id in zip(panels, ids, strict=True):
        env = gymnasium.make(env_id, render_mode="rgb_array")
        env.reset(seed=SEED)
        panel.imshow(env.render()[crop], interpolation=interpolation)
        panel.set_title(env_id.removeprefix("SPRL/").removesuffix("-v1"), fontsize=11)
        panel.set_axis_off()
        env.close()
    figure.savefig(path, dpi=110)


if __name__ == "__main__":
    main(*sys.argv[1:])
