"""Draw the picture of docs/optimality.md and print its figures.

As in `python notes/theory/draw_optimality.py docs/optimality.png`.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Final

import gymnasium
import numpy as np

import sprl_bench  # noqa: F401 - registers the ids
from sprl_bench import plots, theory
from sprl_bench.scores import Array

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

KS: Final = (0, 1, 2, 3, 5, 10)
DEPTH: Final = 14
MAPS: Final = 10
TRAPS: Final = np.linspace(0, 0.4, 41)
DISCOUNT: Final = 0.9
COLOURS: Final = ("#000000", "#56B4E9", "#009E73", "#E69F00", "#0072B2", "#D55E00")


def main() -> None:
    """Draw, and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("picture", type=Path)
    shares, states, lengths = key_shares()
    plots.save(lambda: draw(shares), parser.parse_args().picture)
    print(f"KeyDoors-7x7, seeds 0 to {MAPS - 1}: {states.min()} to {states.max()} states, {lengths.min()} to ", end="")
    print(f"{lengths.max()} steps to the goal")
    for k, mean in zip(KS, shares.mean(axis=0), strict=True):
        print(f"k = {k}: share of length {DEPTH} {mean[DEPTH]:.3g}")


def key_shares() -> tuple[Array, Array, Array]:
    """Return the shares [map, k, length], the number of states and the shortest length of each map."""
    env = gymnasium.make("SPRL/KeyDoors-7x7-v1")
    worlds = [theory.key_world(env.reset(seed=seed)[0]) for seed in range(MAPS)]
    shares = [[theory.shares(world, k, DEPTH) for k in KS] for world in worlds]
    lengths = [len(theory.shortest_path(world)) - 1 for world in worlds]
    return np.array(shares), np.array([theory.num_reachable(world) for world in worlds]), np.array(lengths)


def risky(trap: float) -> theory.RewardedWorld:
    """Return the counter-example: one action reaches the goal 3 or the trap 4, the other walks there by 1 and 2."""
    transitions = np.zeros((5, 2, 5))
    transitions[0, 0, [3, 4]] = 1 - trap, trap
    transitions[0, 1, 1] = transitions[1, :, 2] = transitions[2, :, 3] = transitions[3, :, 3] = transitions[4, :, 4] = 1
    ends = np.array([False, False, False, True, True])
    return theory.RewardedWorld(transitions, np.array([0.0, 0, 0, 1, 0]), ends, 0, DISCOUNT)


def draw(shares: Array) -> Figure:
    """Return both panels: what the constraint prunes on KeyDoors, and where the optimum breaks it."""
    from matplotlib.figure import Figure  # noqa: PLC0415 - slow to load

    figure = Figure(figsize=(7.2, 2.9), layout="constrained")
    left, right = figure.subplots(1, 2)
    for k, colour, line in zip(KS, COLOURS, shares.mean(axis=0), strict=True):
        left.semilogy(range(DEPTH + 1), line, color=colour, label=f"k = {k}")
    left.yaxis.set_major_formatter("{x:g}")
    left.set_title("KeyDoors-7x7: admissible share")
    left.set_xlabel("length of a trajectory")
    left.legend(fontsize=7)
    _draw_risk(right)
    return figure


def _draw_risk(axes: Axes) -> None:
    worlds = [risky(trap) for trap in TRAPS]
    short = np.eye(2)[[0] * 5]
    axes.plot(TRAPS, [theory.best_values(world)[0] for world in worlds], color="#0072B2", label="optimum")
    axes.plot(
        TRAPS,
        [theory.policy_values(world, short)[0] for world in worlds],
        "--",
        color="#D55E00",
        label="shortest path",
    )
    axes.set_title("A risky short way")
    axes.set_xlabel("chance that it ends in a trap")
    axes.set_ylabel("value of the start")
    axes.legend(fontsize=7)


if __name__ == "__main__":
    main()
