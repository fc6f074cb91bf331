"""The probe of SPRL's network: it leaves training as it is, and counts what it says it counts."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import gymnasium
import pytest
import torch

import sprl_bench  # noqa: F401 - registers the ids
from benchmarks import network_errors
from benchmarks.network_errors import FAR, Probed, report
from sprl_baselines import agents
from sprl_baselines.bonus import Setting
from sprl_baselines.reachability import GroundTruth
from sprl_baselines.rollout import Rollout
from sprl_baselines.sprl import SPRLConfig

LEARNER = {"num_envs": 3, "rollout_length": 32}
NETWORK = {"replay_size": 400, "train_every": 96, "pair_batch": 8, "max_pairs": 16, "ready_trainings": 1}


def trained(factory: Any, **settings: Any) -> tuple[Any, list[dict[str, float]]]:
    """Return an agent after six updates, and its metrics."""
    envs = gymnasium.make_vec("SPRL/KeyDoors-7x7-v1", num_envs=3)
    envs.reset(seed=0)
    agent = factory(seed=0, **factory.hyperparameters("grid", {**LEARNER, **settings}))
    updates = agent.train(envs, budget=10**9)
    return agent, [next(updates) for _ in range(6)]


def parameters(agent: Any) -> torch.Tensor:
    return torch.cat([value.flatten().double() for value in agent.learner.network.state_dict().values()])


@pytest.mark.parametrize("name", ["sprl", "gt_sprl"])
def test_what_is_probed_trains_as_ever(name: str) -> None:
    settings = {**NETWORK, "ready_accuracy": 0.0}
    probed, lines = trained(getattr(network_errors, name), **settings)
    plain, _ = trained(getattr(agents, name), **(settings if name == "sprl" else {}))
    assert torch.equal(parameters(probed), parameters(plain))
    assert "charged_exactly" in lines[-1]


def test_nothing_is_counted_before_the_network_is_trusted() -> None:
    for factory in (network_errors.sprl, network_errors.gt_sprl):
        _, lines = trained(factory, **NETWORK, ready_accuracy=0.99)
        assert not any("charged_exactly" in line for line in lines)


@pytest.mark.parametrize("name", ["sprl", "gt_sprl"])
def test_a_probe_goes_on_from_its_state(name: str) -> None:
    """What a judge before a change is found to say is not said again of other steps."""
    factory = getattr(network_errors, name)
    envs = gymnasium.make_vec("SPRL/KeyDoors-7x7-v1", num_envs=3)
    envs.reset(seed=0)
    settings = factory.hyperparameters("grid", {**LEARNER, **NETWORK, "ready_accuracy": 0.0})
    agent = factory(seed=0, **settings)
    updates = agent.train(envs, budget=10**9)
    for _ in range(6):
        next(updates)
    other_envs = gymnasium.make_vec("SPRL/KeyDoors-7x7-v1", num_envs=3)
    other_envs.reset(seed=1)
    other_envs.set_state(envs.get_state())  # type: ignore[attr-defined] # the engine's own
    other = factory(seed=0, **settings)
    other.load_state_dict(agent.state_dict())
    for expected, found in zip([next(updates) for _ in range(3)], other.train(other_envs, budget=10**9), strict=False):
        assert expected["stretches_at_0"] > 0
        assert found == expected
    assert torch.equal(parameters(agent), parameters(other))


class Opposite(GroundTruth):
    """A judge that is always wrong."""

    def judge_of(self, states: torch.Tensor) -> Any:
        right = super().judge_of(states)
        return lambda earlier, later: 1 - right(earlier, later)


def found(judge: type[GroundTruth]) -> dict[str, float]:
    """Return what is counted of one rollout of 96 random steps with a judge in the network's place."""
    agent, _ = trained(agents.ppo)
    rollout: Rollout = agent._collector.collect(agent.learner.act)
    space = agent._collector._envs.single_observation_space
    setting = Setting(space, gymnasium.spaces.Discrete(7), 3, seed=0, device=torch.device("cpu"))
    config = SPRLConfig(k=2, tolerance_samples=10)
    bonus = Probed(setting, config, judge(space, config.k), priced_by_network=True)
    bonus.reward(rollout)
    return dict(bonus.update(rollout))


def test_a_network_that_is_right_agrees_with_the_search() -> None:
    counts = found(GroundTruth)
    assert 0 < counts["charged_exactly"] == counts["charged_by_network"] == counts["charged_by_both"] < 1
    assert sum(counts[f"stretches_at_{distance}"] for distance in range(FAR + 1)) > 40
    for distance in range(FAR + 1):
        assert counts[f"reached_at_{distance}"] == counts[f"stretches_at_{distance}"] * (distance <= 2)


def test_a_network_that_is_wrong_disagrees_on_every_stretch() -> None:
    right, wrong = found(GroundTruth), found(Opposite)
    assert right["charged_exactly"] == wrong["charged_exactly"] != wrong["charged_by_network"]
    for distance in range(FAR + 1):
        assert right[f"stretches_at_{distance}"] == wrong[f"stretches_at_{distance}"]
        assert wrong[f"reached_at_{distance}"] == wrong[f"stretches_at_{distance}"] * (distance > 2)


def test_a_report_has_a_line_for_each_part_of_a_run(tmp_path: Path) -> None:
    _, lines = trained(network_errors.sprl, **NETWORK, ready_accuracy=0.0)
    steps = [{"env_steps": 96 * count, **line} for count, line in enumerate(lines, start=1)]
    (tmp_path / "metrics.jsonl").write_text("".join(json.dumps(line) + "\n" for line in steps))
    rows = report(tmp_path).splitlines()
    assert 0 < len(rows) <= network_errors.WINDOWS
    assert rows[-1].startswith("to       576: accuracy 0.")
    assert f"charged exactly {lines[-1]['charged_exactly']:.3f}" in rows[-1]


def test_a_report_of_nothing_says_so(tmp_path: Path) -> None:
    for text in ("", '{"env_steps": 96}\n'):
        (tmp_path / "metrics.jsonl").write_text(text)
        assert report(tmp_path) == "nothing was counted"


def test_a_report_weighs_every_stretch_alike(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    counted = {"charged_exactly": 0.5, "charged_by_network": 0.4, "charged_by_both": 0.3}
    lines = [
        {"env_steps": 1, **counted, "stretches_at_0": 90, "reached_at_0": 90},
        {"env_steps": 2, **counted, "stretches_at_0": 10, "reached_at_0": 0},
    ]
    (tmp_path / "metrics.jsonl").write_text("".join(json.dumps(line) + "\n" for line in lines[1:] + lines[:1]))
    monkeypatch.setattr(network_errors, "WINDOWS", 1)
    assert "by both 0.300; reached at 0 to 6: 0.90 - - - - - - (shares 1.00 0.00" in report(tmp_path)
