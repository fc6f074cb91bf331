"""How PPO's settings for the grids are chosen, where the paper's appendix gives none.

The runs are declared here and in notes/ppo-sweep.md before they are made. To make them, or to continue:
`python notes/sweeps/sweep_ppo_grid.py runs/ppo-sweep`. A second argument is the number of runs at once, 2 by default.
"""

from __future__ import annotations

import itertools
import sys
from pathlib import Path

from sweeps import Setting, Sweep

SETTINGS: list[Setting] = [
    {
        "clip_range": clip_range,
        "anneal_clip_range": anneal,
        "anneal_learning_rate": anneal,
        "rollout_length": rollout_length,
    }
    for clip_range, anneal, rollout_length in itertools.product((0.2, 0.1), (False, True), (128, 256))
]
SWEEP = Sweep("ppo", SETTINGS, "grid", {"FourRooms-11x11": 300_000, "FourRooms-7x7": 300_000}, seeds=(0, 1))


def main(root: Path, workers: int = 2) -> None:
    """Run the sweep and print every AUC, the best setting first."""
    SWEEP.run(root, workers)
    print(SWEEP.report(root))


if __name__ == "__main__":
    main(Path(sys.argv[1]), *map(int, sys.argv[2:3]))
