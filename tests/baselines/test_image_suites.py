"""Every agent on the suites of images: stopped by a signal and run again, it gives the record of an unstopped run."""

from __future__ import annotations

import json
import os
import signal
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from safetensors import safe_open

from sprl_bench.records import RunRecord, read
from sprl_bench.run import InterruptedRunError, run
from sprl_bench.suite import expand
from sprl_bench.tasks import SUITES

AGENTS = {
    "atari-smoke": ("eco", "icm", "ppo", "random", "rnd", "sprl"),
    "maze-smoke": ("eco", "gt-grid", "icm", "ppo", "random", "rnd", "sprl"),
}
TASK = {"atari-smoke": "MsPacman", "maze-smoke": "MazeGoalSmall"}
ROWS = [(suite, agent) for suite, agents in AGENTS.items() for agent in agents]
BUDGET = int(os.environ.get("SPRL_IMAGE_STEPS", "20000"))  # of the long version
DEVICE = os.environ.get("SPRL_IMAGE_DEVICE", "cpu")  # of the long version
SMALL: dict[str, Any] = {"num_envs": 2, "rollout_length": 16, "epochs": 1, "minibatches": 1}
SMALL_NETWORK = {  # trained after every rollout, and used from the second one on
    "k": 2,
    "negative_bias": 2,
    "positive_bias": 2,
    "replay_size": 32,
    "train_every": 32,
    "max_pairs": 8,
    "pair_batch": 4,
    "ready_trainings": 1,
    "ready_accuracy": 0.0,
    "accuracy_pairs": 8,
    "head_units": 16,
    "embedding_units": 16,
}
SETTINGS = {
    "random": {"num_envs": 2},
    "icm": {**SMALL, "icm_epochs": 1, "icm_minibatches": 1},
    "rnd": {**SMALL, "rnd_epochs": 1, "rnd_minibatches": 1},
    "eco": {**SMALL, **SMALL_NETWORK, "memory_size": 4},
    "sprl": {**SMALL, **SMALL_NETWORK, "tolerance_samples": 2},
}


@pytest.fixture(autouse=True)
def _games(request: pytest.FixtureRequest) -> None:
    if request.node.callspec.params["suite"] == "atari-smoke":
        pytest.importorskip("ale_py")


def sends_a_signal_at(update: int) -> Callable[[], bool]:
    """Return a `stop` that never asks for it, but sends SIGTERM to this process after an update."""
    updates = iter(range(1, 10**6))

    def stop() -> bool:
        if next(updates) == update:
            os.kill(os.getpid(), signal.SIGTERM)
        return False

    return stop


def files(folder: Path) -> dict[str, Any]:
    """Return what a run has written, without times."""
    record = read(folder / "record.json", RunRecord)
    kept = ("spec", "status", "return_curve", "success_curve", "scores", "totals", "fingerprint")
    lines = [json.loads(line) for line in (folder / "metrics.jsonl").read_text().splitlines()]
    return {
        **{name: getattr(record, name) for name in kept},
        "episodes": (folder / "episodes.parquet").read_bytes(),
        "metrics": [{**line, "wall_time_s": 0} for line in lines],
        "weights": _digest(folder / "weights.safetensors"),
    }


def _digest(weights: Path) -> str:
    if not weights.exists():  # as those of `random`
        return ""
    with safe_open(weights, framework="numpy") as file:
        return str(file.metadata()["digest"])


def check(suite: str, agent: str, folder: Path, device: str = "cpu", **arguments: Any) -> list[dict[str, Any]]:
    """Compare a run with one that is stopped after its second update; return its metrics."""
    (spec,) = expand(SUITES[suite], [agent], [0], tasks=[TASK[suite]], device=device, **arguments)
    run(spec, folder / "whole")
    with pytest.raises(InterruptedRunError, match="the same command continues from there"):
        run(spec, folder / "halves", stop=sends_a_signal_at(1))
    run(spec, folder / "halves")
    whole, halves = (files(spec.path(folder / name)) for name in ("whole", "halves"))
    for name, value in whole.items():
        assert halves[name] == value, name
    metrics: list[dict[str, Any]] = whole["metrics"]
    return metrics


@pytest.mark.parametrize(("suite", "agent"), ROWS)
def test_an_interrupted_run_equals_an_uninterrupted_one(suite: str, agent: str, tmp_path: Path) -> None:
    budget = 1280 if agent == "random" else 96  # two and a half reports of `random`, three rollouts of the others
    metrics = check(suite, agent, tmp_path, budget=budget, overrides=SETTINGS.get(agent, SMALL))
    assert len(metrics) >= 3
    if agent in ("eco", "sprl"):
        assert any("reachability_loss" in line for line in metrics[:2])  # trained before the interruption
        assert any(line["bonus"] for line in metrics[2:])


@pytest.mark.slow
@pytest.mark.parametrize(("suite", "agent"), ROWS)
def test_a_run_of_the_whole_suites_length_does_too(suite: str, agent: str, tmp_path: Path) -> None:
    """With the published settings; hours for the residual networks of `eco` and `sprl` on a CPU."""
    check(suite, agent, tmp_path, DEVICE, budget=BUDGET)


@pytest.mark.parametrize(
    ("suite", "agent"),
    [(suite, agent) for suite in AGENTS for agent in ("count", "gt-grid", "gt-sprl") if agent not in AGENTS[suite]],
)
def test_agents_without_settings_for_images_are_refused(suite: str, agent: str) -> None:
    with pytest.raises(ValueError, match=f"agent is '{agent}'; it must be one with the preset 'table' of domain"):
        expand(SUITES[suite], [agent], [0], tasks=[TASK[suite]], device="cpu")
