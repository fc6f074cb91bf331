"""The probe of SPRL's network: it leaves training as it is, and counts what it says it counts."""

from __future__ import annotations

import json
import math
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


def test_a_probe_goes_on_from_its_state() -> None:
    agent, lines = trained(network_errors.gt_sprl, **NETWORK, ready_accuracy=0.0)
    other, _ = trained(network_errors.gt_sprl, **NETWORK, ready_accuracy=0.99)
    assert not other.bonus._network.ready
    other.bonus.load_state_dict(agent.bonus.state_dict())
    assert other.bonus._network.ready
    assert other.bonus._found == {name: lines[-1][name] for name in other.bonus._found}


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
    assert sum(counts[f"stretches_at_{distance}"] for distance in range(FAR + 1)) == pytest.approx(1)
    for distance in range(FAR + 1):
        if counts[f"stretches_at_{distance}"]:
            assert counts[f"reached_at_{distance}"] == (distance <= 2)


def test_a_network_that_is_wrong_disagrees_on_every_stretch() -> None:
    right, wrong = found(GroundTruth), found(Opposite)
    assert right["charged_exactly"] == wrong["charged_exactly"] != wrong["charged_by_network"]
    for distance in range(FAR + 1):
        assert right[f"stretches_at_{distance}"] == wrong[f"stretches_at_{distance}"]
        if right[f"stretches_at_{distance}"]:
            assert wrong[f"reached_at_{distance}"] == 1 - right[f"reached_at_{distance}"]


def test_a_report_has_a_line_for_each_part_of_a_run(tmp_path: Path) -> None:
    _, lines = trained(network_errors.sprl, **NETWORK, ready_accuracy=0.0)
    steps = [{"env_steps": 96 * count, **line} for count, line in enumerate(lines, start=1)]
    plain = [
        {key: None if isinstance(value, float) and math.isnan(value) else value for key, value in line.items()}
        for line in steps
    ]
    (tmp_path / "metrics.jsonl").write_text("".join(json.dumps(line) + "\n" for line in plain))
    rows = report(tmp_path).splitlines()
    assert 0 < len(rows) <= network_errors.WINDOWS
    assert rows[-1].startswith("to       576: accuracy 0.")
    assert f"charged exactly {lines[-1]['charged_exactly']:.3f}" in rows[-1]
