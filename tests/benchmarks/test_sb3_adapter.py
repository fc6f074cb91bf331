"""The benchmark of the adapter for Stable-Baselines3: every contender takes the steps that are counted."""

from __future__ import annotations

from typing import Any

import pytest

from benchmarks import sb3_adapter
from benchmarks.sb3_adapter import OWN_STEPS, ROLLOUT, STEPS, TASK
from sprl_bench.envs.grid.grid_env import GridEnv
from sprl_bench.envs.vector import BatchedEnv

NUM_ENVS = 8


@pytest.mark.parametrize(
    ("contender", "kind", "work"),
    [
        ("engine", BatchedEnv, STEPS // NUM_ENVS),
        ("adapter", BatchedEnv, STEPS // NUM_ENVS),
        ("their_own", GridEnv, OWN_STEPS),
    ],
)
def test_a_turn_takes_the_steps_that_are_counted(
    contender: str, kind: Any, work: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("stable_baselines3")
    taken = 0
    step = kind.step

    def counted(env: Any, action: Any) -> Any:
        nonlocal taken
        taken += 1
        return step(env, action)

    monkeypatch.setattr(kind, "step", counted)
    turn = getattr(sb3_adapter, contender)(NUM_ENVS)
    assert turn() in (STEPS, OWN_STEPS)
    assert taken == work, TASK


def test_the_time_of_the_adapter_in_a_training_is_its_own() -> None:
    pytest.importorskip("stable_baselines3")
    turn, adapter = sb3_adapter.training(NUM_ENVS)
    assert turn() == ROLLOUT * NUM_ENVS
    assert adapter.inner
    assert 0 < adapter.inner.seconds < adapter.seconds
    assert adapter.alone == adapter.seconds - adapter.inner.seconds
