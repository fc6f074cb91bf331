"""Section 6.6: how much the constraint prunes, counted exactly on small worlds. Nothing is trained."""

from __future__ import annotations

import functools
from pathlib import Path
from typing import TYPE_CHECKING, Final

import gymnasium
import numpy as np

from sprl_bench import plots, theory
from sprl_bench.scores import Array
from sprl_bench.studies.verdicts import Verdict

if TYPE_CHECKING:  # the extra `plots`
    from matplotlib.figure import Figure

ENV_ID: Final = "SPRL/FourRooms-7x7-v1"
KS: Final = (0, 1, 2, 3, 5, 10)
DEPTH: Final = 14
MAPS: Final = 10


@functools.cache
def counted() -> tuple[Array, bool]:
    """Return the shares of admissible trajectories, [map, k, length], and whether every shortest path is admissible.

    The maps are the first states of the seeds 0 to 9. Trajectories of length 0 to 14 turn and go forward.
    """
    env = gymnasium.make(f"sprl_bench:{ENV_ID}")
    worlds = [theory.pose_world(env.reset(seed=seed)[0]) for seed in range(MAPS)]
    env.close()
    shares = np.array([[theory.shares(world, k, DEPTH) for k in KS] for world in worlds])
    paths = [(theory.shortest_path(world), theory.distances(world)) for world in worlds]
    return shares, all(theory.is_admissible(path, table, k) for path, table in paths for k in KS)


def judge_reduction() -> Verdict:
    """Judge the claim that a larger k prunes at least as much at each length, and that a shortest path remains."""
    shares, remains = counted()
    falls = bool((np.diff(shares, axis=1) <= 0).all())
    strictly = bool((np.diff(shares[..., -1], axis=1) < 0).all())
    facts = (
        f"on {MAPS} maps of FourRooms-7x7 the share never rises with k{', and falls strictly' * strictly} at length "
        f"{DEPTH}; a shortest path to the goal {'always' if remains else 'does not always'} remain{'s' * remains}"
    )
    return Verdict("supported" if falls and remains else "contradicted", (), fact=facts)


def reduction_table() -> str:
    """Return the mean shares over the maps, Markdown."""
    shares, _ = counted()
    lengths = (2, 5, 10, DEPTH)
    rows = [[f"k = {k}", *(f"{shares[:, row, length].mean():.2g}" for length in lengths)] for row, k in enumerate(KS)]
    head = ["share of admissible trajectories", *(f"length {length}" for length in lengths)]
    return "\n".join(f"| {' | '.join(row)} |" for row in (head, ["---"] * len(head), *rows))


def draw_reduction(picture: Path) -> None:
    """Draw the mean shares against the length, one line a k."""

    def draw() -> Figure:
        from matplotlib.figure import Figure  # noqa: PLC0415 - the extra `plots`, and slow to load

        figure = Figure(figsize=(4.2, 3.2), layout="constrained")
        axes = figure.subplots()
        for row, k in enumerate(KS):
            axes.semilogy(range(DEPTH + 1), counted()[0][:, row].mean(axis=0), label=f"k = {k}")
        axes.yaxis.set_major_formatter("{x:g}")
        axes.set_xlabel("length of a trajectory")
        axes.set_ylabel("admissible share")
        axes.legend()
        return figure

    plots.save(draw, picture)
