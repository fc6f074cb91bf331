"""Compare the returns of notes/atari-ppo.md: `python notes/atari_ppo.py RUNS`, the folder of its two runs."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pyarrow.parquet

from sprl_bench.records import find_records
from sprl_bench.studies.verdicts import difference


def returns_of(root: Path, agent: str, last: float) -> np.ndarray:
    """Return the returns of the episodes that ended in the last share of an agent's steps, [E]."""
    [record] = [record for record in find_records(root) if record.spec.agent == agent]
    table = pyarrow.parquet.read_table(record.spec.path(root) / "episodes.parquet").to_pydict()
    ends, returns = np.array(table["stamp"]), np.array(table["return"])
    return returns[ends > (1 - last) * record.spec.task.budget]


if __name__ == "__main__":
    root = Path(sys.argv[1])
    learned, random = returns_of(root, "ppo", 0.1), returns_of(root, "random", 1.0)
    print(f"ppo: {learned.mean():.1f} over {len(learned)} episodes; random: {random.mean():.1f} over {len(random)}.")
    print(difference("ppo minus random", [learned], [random]))
