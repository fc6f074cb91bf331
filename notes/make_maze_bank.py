"""Write the mazes' layouts with DeepMind Lab's generator.

`pip install labmaze==1.0.6` (Python 3.12 at most), then `python notes/make_maze_bank.py`.
"""

from __future__ import annotations

import labmaze
import numpy as np

from sprl_bench.envs.maze.levels import GENERATORS, NUM_LAYOUTS
from sprl_bench.envs.maze.maze_bank import Layouts, bank_file, from_text, pack


def generate(level: str, seed: int) -> Layouts:
    """Return the layout of one of the generator's seeds, uint8 [S, S]."""
    maze = labmaze.RandomMaze(**GENERATORS[level], random_seed=seed)
    return from_text(str(maze.entity_layer), str(maze.variations_layer))


def main() -> None:
    """Write the file of every level."""
    for level in GENERATORS:
        made = np.array([generate(level, seed) for seed in range(NUM_LAYOUTS)])
        bank_file(level).write_bytes(pack(made))
        print(level, bank_file(level).stat().st_size, "bytes")


if __name__ == "__main__":
    main()
