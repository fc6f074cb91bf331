"""Compare the returns of notes/atari-ppo.md: `python notes/atari_ppo.py RUNS`, the folder of its runs."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pyarrow.parquet

from sprl_bench.records import RunRecord, find_records
from sprl_bench.studies.verdicts import difference


def returns_of(root: Path, agent: str, last: float) -> list[np.ndarray]:
    """Return for each seed the returns of the episodes that ended in the last share of an agent's steps, each [E]."""
    return [_returns(root, record, last) for record in find_records(root) if record.spec.agent == agent]


def _returns(root: Path, record: RunRecord, last: float) -> np.ndarray:
    table = pyarrow.parquet.read_table(record.spec.path(root) / "episodes.parquet").to_pydict()
    ends, returns = np.array(table["stamp"]), np.array(table["return"])
    return returns[ends > (1 - last) * record.spec.task.budget]


def main(root: Path) -> None:
    """Print the mean return of each seed, and the difference over all episodes."""
    learned, random = returns_of(root, "ppo", 0.1), returns_of(root, "random", 1.0)
    for agent, seeds in (("ppo", learned), ("random", random)):
        print(f"{agent}: {', '.join(f'{one.mean():.1f} over {len(one)} episodes' for one in seeds)}.")
    print(difference("ppo minus random", [np.concatenate(learned)], [np.concatenate(random)]))
    print(difference("ppo minus random, one mean a seed", [means(learned)], [means(random)]))


def means(seeds: list[np.ndarray]) -> np.ndarray:
    """Return the mean of each seed, [S]."""
    return np.array([one.mean() for one in seeds])


if __name__ == "__main__":
    main(Path(sys.argv[1]))
