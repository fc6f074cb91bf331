"""Draw the picture of docs/theory.md and print its figures: `python notes/theory/draw_theory.py docs/theory.png`."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

import sprl_bench
from sprl_bench import theory
from theory_plots import KS, plot_theory

ENV_ID = "SPRL/FourRooms-7x7-v1"
SEED = 3
MAPS = 20
WALKS = 200
Worlds = Callable[[Any], theory.World]


def main(path: str) -> None:
    """Draw the first state of seed 3, and print tables of that map and of the means over 20 maps."""
    gymnasium.register_envs(sprl_bench)
    maps = [gymnasium.make(ENV_ID).reset(seed=seed)[0] for seed in range(MAPS)]
    plot_theory(maps[SEED], Path(path))
    for model in (theory.cardinal_world, theory.pose_world):
        describe_map(model, maps[SEED])
        describe_maps(model, maps)


def describe_map(model: Worlds, observation: Any) -> None:
    """Print sizes and shares of one map, for each k."""
    world = model(observation)
    length = len(theory.shortest_path(world)) - 1
    print(f"\n{model.__name__}, seed {SEED}: {theory.num_reachable(world)} states, goal in {length}, ", end="")
    print(f"longest distance {theory.distances(world)[world.start].max()} from the start")
    print("| k | share T = 10 | T = 20 | T = 30 | tree of depth 20 | shortest paths to the goal |\n|" + " --- |" * 6)
    for k in KS:
        shares, counts = theory.shares(world, k, 30), theory.count_trajectories(world, k, 20)
        columns = [f"{shares[steps]:.1e}" for steps in (10, 20, 30)]
        print("|", k, "|", " | ".join(columns), "|", f"{counts.tree_sizes[20]:,}", "|", counts.ended[length], "|")


def describe_maps(model: Worlds, maps: list[Any]) -> None:
    """Print the mean number of steps to the goal for each k, and how k = 3 differs from k = 2, over all maps."""
    print(f"\n{model.__name__}, mean of {MAPS} maps, {WALKS} walks each, +- one standard error over maps")
    means = {k: mean_steps(model, maps, k) for k in KS}
    for k in KS:
        print(f"k = {k}: {describe(means[k])}")
    slower = means[3] - means[2]
    print(f"k = 3 is slower than k = 2 on {(slower > 0).sum()} maps, by {describe(slower)}")


def mean_steps(model: Worlds, maps: list[Any], k: int) -> NDArray[np.float64]:
    """Return the mean number of steps to the goal on each map."""
    rng = np.random.default_rng((1, k))
    return np.array([theory.steps_to_goal(model(each), k, rng, episodes=WALKS).mean() for each in maps])


def describe(values: NDArray[np.float64]) -> str:
    """Return the mean with its standard error."""
    return f"{values.mean():.1f} +- {values.std(ddof=1) / len(values) ** 0.5:.1f}"


if __name__ == "__main__":
    main(sys.argv[1])
