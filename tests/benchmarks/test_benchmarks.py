"""What the benchmarks rest on: sweeps that tell of every run, and bonuses that leave PPO's steps as they are."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import gymnasium
import pytest
import torch
from sweep_agents_grid import SETTINGS

import sprl_bench  # noqa: F401 - registers the ids
from benchmarks import workers
from benchmarks.agents import SAME_STEPS
from sprl_bench.agents import load_factory
from sprl_bench.records import find_records
from sweeps import Sweep

WIDE, NARROW = {"num_envs": 6}, {"num_envs": 3}


def sweep(**changes: Any) -> Sweep:
    plan: dict[str, Any] = {"settings": [WIDE, NARROW], "seeds": (0, 1), "budgets": {"FourRooms-7x7": 1200}}
    return Sweep("random", suite="smoke", **{**plan, **changes})


def test_a_sweep_reports_every_run_and_the_best_setting_first(tmp_path: Path) -> None:
    sweep().run(tmp_path, workers=1)
    lines = sweep().report(tmp_path).splitlines()
    means = [float(line.rpartition("mean ")[2]) for line in lines]
    assert means == sorted(means, reverse=True)
    for setting in (WIDE, NARROW):
        folder = tmp_path / "random" / f"num_envs={setting['num_envs']}"
        aucs = [record.scores.auc for record in find_records(folder)]
        [line] = [line for line in lines if folder.name in line]
        assert f"FourRooms-7x7 {aucs[0]:.3f} {aucs[1]:.3f}  mean {sum(aucs) / 2:.3f}" in line


def test_a_sweep_with_a_missing_run_has_no_result(tmp_path: Path) -> None:
    sweep(seeds=(0,)).run(tmp_path, workers=1)
    with pytest.raises(ValueError, match="num_envs=6 has 1 of 2 runs"):
        sweep().report(tmp_path)


def test_a_sweep_with_a_failed_run_stops(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(Path(__file__).parents[1] / "fakes")
    broken = Sweep("harness_fakes:broken", [NARROW], "smoke", {"FourRooms-7x7": 600}, seeds=(0,))
    with pytest.raises(RuntimeError, match=r"seed-0: .*divided by zero"):
        broken.run(tmp_path, workers=1)


def test_every_agent_gets_as_many_settings() -> None:
    assert {len(settings) for settings in SETTINGS.values()} == {4}


@pytest.mark.parametrize("agent", sorted(set(SAME_STEPS) - {"ppo"}))
def test_a_bonus_that_weighs_nothing_leaves_the_learner_as_it_is(agent: str) -> None:
    """So agents that are timed against PPO live through the very same steps."""

    def learned(name: str) -> dict[str, torch.Tensor]:
        small = {"num_envs": 2, "rollout_length": 16}
        network = {"replay_size": 100, "train_every": 32, "pair_batch": 4, "max_pairs": 4}
        own = network if name in ("eco", "sprl") else {}
        factory = load_factory(name)
        settings = factory.hyperparameters("grid", {**SAME_STEPS[name], **small, **own})  # type: ignore[attr-defined]
        envs = gymnasium.make_vec("SPRL/FourRooms-7x7-v1", num_envs=2)
        envs.reset(seed=0)
        made: Any = factory(seed=0, **settings)
        updates = made.train(envs, budget=10**9)
        for _ in range(6):
            next(updates)
        assert name not in ("eco", "sprl") or made.bonus.reachability.ready
        parameters: dict[str, torch.Tensor] = made.learner.network.state_dict()
        return parameters

    for ours, theirs in zip(learned(agent).values(), learned("ppo").values(), strict=True):
        assert torch.equal(ours, theirs)


def test_two_workers_train_two_seeds() -> None:
    assert workers.training(seeds=2, workers=2, budget=1_536, counted=3)() == 3 * 2 * 1_536
    with pytest.raises(ValueError, match="budget"):
        workers.training(seeds=1, workers=1, budget=-1)()
