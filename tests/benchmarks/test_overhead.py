"""The benchmark of the recorder: turns are interleaved, and each contender is what its row says."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from benchmarks import overhead
from benchmarks.turns import Turn
from sprl_bench.records.folder import ACTIONS


def test_turns_are_interleaved_after_one_round_that_is_not_measured() -> None:
    order: list[str] = []

    def contender(name: str, work: int) -> Turn:
        def turn() -> int:
            order.append(name)
            return len(np.arange(work).argsort())

        return turn

    quick, slow = overhead.rates([contender("quick", 100_000), contender("slow", 100_000)], 3)
    assert order == ["quick", "slow"] * 4
    assert len(quick) == len(slow) == 3
    assert min(quick) > 0


@pytest.mark.parametrize(("ours", "verdict"), [([98.0, 99.0, 40.0], ""), ([90.0, 99.0, 90.0], "Below its bar")])
def test_the_ratio_is_the_median_of_the_pairs(ours: list[float], verdict: str) -> None:
    row = overhead.row("ours", ours, "theirs", [100.0] * 3, bar=0.97)
    assert row.ratio == sorted(ours)[1] / 100
    assert row.verdict == verdict


@pytest.mark.parametrize(("keep", "files"), [("no", 0), ("yes", 1)])
def test_only_one_of_the_recorded_contenders_keeps_its_actions(keep: str, files: int, tmp_path: Path) -> None:
    turn = overhead.recording(tmp_path, keep)
    assert turn() == overhead.plain()() > 1_000
    tapes = list(tmp_path.rglob(ACTIONS))
    assert len(tapes) == files
    assert all(tape.stat().st_size > 300 for tape in tapes)
