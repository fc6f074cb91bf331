"""What a framework counts itself is what the recorder wrote: the return and the length of every episode, in its order.

`tests/test_sb3.py` does the same with the monitor of Stable-Baselines3.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from gymnasium.wrappers import RecordEpisodeStatistics
from gymnasium.wrappers.vector import RecordEpisodeStatistics as RecordVectorStatistics
from pyarrow import parquet

import sprl_bench
from sprl_bench.records.folder import EPISODES

BUDGET: Final = 3_000
Counted = list[tuple[float, int]]


def recorded(env: Any, out: Path) -> Any:
    return sprl_bench.record(env, out=out, agent="counted", seed=0, budget=BUDGET)


def around_the_recorder(env_id: str, out: Path) -> Any:
    """Gymnasium's vector wrapper, as on its page."""
    return RecordVectorStatistics(recorded(gymnasium.make_vec(env_id, num_envs=4, autoreset_mode="NextStep"), out))


def inside_of_a_sync_vector_env(env_id: str, out: Path) -> Any:
    """A wrapper around each recorded sub-environment, as in CleanRL's scripts."""
    made = [lambda: RecordEpisodeStatistics(recorded(gymnasium.make(f"sprl_bench:{env_id}"), out)) for _ in range(4)]
    return SyncVectorEnv(made, autoreset_mode=AutoresetMode.NEXT_STEP)


def counted_by_wrappers(envs: Any) -> Counted:
    envs.reset(seed=0)
    envs.action_space.seed(0)
    counted: Counted = []
    for _ in range(BUDGET // 4 + 200):  # a step that resets is not counted
        infos = envs.step(envs.action_space.sample())[-1]
        if "episode" in infos:
            ended = np.flatnonzero(infos["_episode"])
            counted += [(float(infos["episode"]["r"][env]), int(infos["episode"]["l"][env])) for env in ended]
    return counted


@pytest.mark.parametrize("env_id", ["SPRL/FourRooms-7x7-v1", "SPRL/FetchReachSparse-v1"])
@pytest.mark.parametrize("make", [around_the_recorder, inside_of_a_sync_vector_env])
def test_a_wrapper_counts_what_is_recorded(make: Callable[[str, Path], Any], env_id: str, tmp_path: Path) -> None:
    if "Fetch" in env_id:
        pytest.importorskip("mujoco")
    envs = make(env_id, tmp_path)
    counted = counted_by_wrappers(envs)
    envs.close()
    [record] = sprl_bench.find_records(tmp_path)
    [path] = tmp_path.rglob(EPISODES)
    rows = parquet.read_table(path).to_pydict()
    within = counted[: record.totals.episodes]
    assert record.status == "complete"
    assert record.totals.episodes > 10
    assert rows["length"] == [length for _, length in within]
    assert rows["return"] == pytest.approx([value for value, _ in within], abs=1e-5)
    assert record.totals.mean_return == pytest.approx(np.mean([value for value, _ in within]), abs=1e-5)
