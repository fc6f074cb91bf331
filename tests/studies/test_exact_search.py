"""What exact search scores on the pairs by which the network's accuracy is measured."""

from __future__ import annotations

from pathlib import Path

import gymnasium
import numpy as np
import pytest

from cli_calls import Capture, call
from sprl_bench import executors
from sprl_bench.studies import exact_search
from sprl_bench.studies.exact_search import accuracy, by_random

GRID = "SPRL/FourRooms-7x7-v1"


class Here:
    """Runs in this process."""

    def map(self, function, specs):
        for spec in specs:
            yield spec, function(spec)


def walk(actions: list[int], seed: int = 0) -> np.ndarray:
    env = gymnasium.make(f"sprl_bench:{GRID}")
    seen = [env.reset(seed=seed)[0]]
    seen += [env.step(action)[0] for action in actions]
    env.close()
    return np.stack(seen)


def test_an_agent_that_stays_leaves_negatives_that_are_near() -> None:
    still = walk([6] * 40)
    assert accuracy([still], k=2, tolerance=1, negative_bias=4) == 0.5  # all positives right, all negatives wrong


def test_short_stretches_have_no_pairs() -> None:
    assert np.isnan(accuracy([walk([6] * 7)], k=2, tolerance=1, negative_bias=5))
    assert not np.isnan(accuracy([walk([6] * 8)], k=2, tolerance=1, negative_bias=5))


def test_turning_on_the_spot_by_hand() -> None:
    """Four turns come back, and turns go both ways: every state is within two actions of every other."""
    turning = walk([0] * 30)
    assert accuracy([turning], k=2, tolerance=1, negative_bias=4) == 0.5
    assert accuracy([turning], k=0, tolerance=1, negative_bias=1) == pytest.approx(
        (0 + 1) / 2
    )  # 1 on: no; 2 or 3 on: no


def test_exact_search_on_random_steps_is_right_for_about_four_in_five_pairs(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(exact_search, "STEPS", 4_000)
    by_random.cache_clear()
    assert by_random(GRID, 2, 1, 20) == pytest.approx(0.80, abs=0.04)
    by_random.cache_clear()


def test_figure_17_shows_exact_search_beside_the_network(
    capsys: Capture, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(executors, "make_executor", lambda *_: Here())
    monkeypatch.setattr(exact_search, "STEPS", 500)
    base = "sprl+num_envs=4+replay_size=512+train_every=256"
    command = [
        "reproduce",
        "fig17",
        "--seeds",
        "1",
        "--budget-share",
        "0.004",
        "--base",
        base,
        "--task",
        "FourRooms-7x7",
    ]
    status, _, err = call(capsys, *command, "--device", "cpu", "--out", tmp_path)
    assert status == 0, err
    rows = [line for line in (tmp_path / "fig17.md").read_text().splitlines() if line.startswith("| FourRooms-7x7 ")]
    by_network, random, last = (float(cell) for cell in rows[-1].strip("| ").split(" | ")[1:])
    assert all(0 <= value <= 1 for value in (by_network, random, last))
