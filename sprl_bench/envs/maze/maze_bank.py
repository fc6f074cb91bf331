"""The layouts of each level, from a file that is shipped with the package.

labmaze, DeepMind Lab's own generator, has no wheels for Python 3.13, and making a layout takes longer than an agent
step. So its first layouts are stored here, and an episode draws one of them. `notes/make_maze_bank.py` writes the file.
"""

from __future__ import annotations

import hashlib
import lzma
from functools import cache
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from sprl_bench.envs.maze.levels import CORRIDOR, FLOOR, LEVELS, NUM_LAYOUTS, PLACE, SPAWN, WALL

Layouts = NDArray[np.uint8]

_DIGEST: Final = "b5e919715ed9f39c052a278c050a21ba7aa78a84d7fee9054fd0a1ab93796e0f"
_FOLDER: Final = Path(__file__).parent
_ROOM: Final = "A"  # in the generator's layer of variations
_TOKENS: Final = {"*": WALL, " ": CORRIDOR, "P": SPAWN, "G": PLACE}


@cache
def layouts(level: str) -> Layouts:
    """Return the layouts of a level, uint8 [NUM_LAYOUTS, S, S] by row y and column x, read-only."""
    size = LEVELS[level].size
    inside = np.frombuffer(lzma.decompress(bank_file(level).read_bytes()), np.uint8)
    cells = np.full((NUM_LAYOUTS, size, size), WALL, np.uint8)
    cells[:, 1:-1, 1:-1] = inside.reshape(NUM_LAYOUTS, size - 2, size - 2)
    cells.flags.writeable = False
    return cells


def bank_file(level: str) -> Path:
    """Return the file with the layouts of a level."""
    return _FOLDER / f"{level}.xz"


def is_intact() -> bool:
    """Return whether all files are those of this version."""
    digest = hashlib.sha256(b"".join(bank_file(level).read_bytes() for level in LEVELS)).hexdigest()
    return digest == _DIGEST


def pack(cells: Layouts) -> bytes:
    """Return the bytes of the file for layouts uint8 [N, S, S]; their border, which is all wall, is left out."""
    return lzma.compress(np.ascontiguousarray(cells[:, 1:-1, 1:-1]).tobytes(), preset=9 | lzma.PRESET_EXTREME)


def from_text(entities: str, variations: str) -> Layouts:
    """Return one layout, uint8 [S, S], from the two layers of text that the generator gives."""
    rows = zip(entities.splitlines(), variations.splitlines(), strict=True)
    return np.array([[_cell(*pair) for pair in zip(*row, strict=True)] for row in rows], np.uint8)


def _cell(entity: str, variation: str) -> int:
    return FLOOR if entity == " " and variation == _ROOM else _TOKENS[entity]
