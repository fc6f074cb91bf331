"""The benchmark of the adapter for Stable-Baselines3: every contender does the work that is counted."""

from __future__ import annotations

import pytest

from benchmarks import sb3_adapter
from benchmarks.sb3_adapter import OWN_STEPS, STEPS


@pytest.mark.parametrize(("contender", "work"), [("engine", STEPS), ("adapter", STEPS), ("their_own", OWN_STEPS)])
def test_a_turn_is_the_work_that_is_counted(contender: str, work: int) -> None:
    pytest.importorskip("stable_baselines3")
    turn = getattr(sb3_adapter, contender)(8)
    assert turn() == turn() == work
