"""What a script that is recorded does, and what it leaves behind."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import gymnasium
import numpy as np

from sprl_bench.records import RunRecord, read

ID = "SPRL/FourRooms-7x7-v1"


def make() -> gymnasium.Env[Any, Any]:
    return gymnasium.make(ID)


def play(env: gymnasium.Env[Any, Any], steps: int, seed: int | None = 0) -> None:
    """Act at random, and reset when an episode is over."""
    generator = np.random.default_rng(seed or 0)
    env.reset(seed=seed)
    for _ in range(steps):
        *_, terminated, truncated, _ = env.step(int(generator.integers(3)))
        if terminated or truncated:
            env.reset()


def play_all(envs: Any, steps: int) -> None:
    generator = np.random.default_rng(0)
    envs.reset(seed=0)
    for _ in range(steps):
        envs.step(generator.integers(3, size=envs.num_envs))


def only_record(out: Path) -> RunRecord:
    (path,) = out.rglob("record.json")
    return read(path, RunRecord)


def episodes(out: Path) -> dict[str, list[Any]]:
    import pyarrow.parquet

    (path,) = out.rglob("episodes.parquet")
    columns: dict[str, list[Any]] = pyarrow.parquet.read_table(path).to_pydict()
    return columns
