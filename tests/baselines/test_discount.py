"""Discounts per action or per simulated time."""

from __future__ import annotations

from typing import Any

import gymnasium
import pytest

import sprl_bench  # noqa: F401 - registers the ids
from sprl_baselines.agents import eco, icm, ppo, rnd, sprl
from sprl_baselines.ppo import PPOConfig


@pytest.mark.parametrize(("discount_per", "time", "gamma"), [("action", 0.2, 0.9), ("reference-action", 0.5, 0.9**0.5)])
def test_a_discount_per_reference_action_keeps_its_horizon_in_simulated_time(
    discount_per: str, time: float, gamma: float
) -> None:
    timed = PPOConfig(gamma=0.9, gae_lambda=0.8, discount_per=discount_per).timed(time)
    assert timed.gamma == pytest.approx(gamma)
    assert timed.gae_lambda == pytest.approx(0.8 ** (time if discount_per == "reference-action" else 1))


def test_the_fetch_environments_say_how_long_an_action_lasts() -> None:
    pytest.importorskip("mujoco")
    for substep, time in ((20, 1.0), (3, 0.15)):
        envs = gymnasium.make_vec("SPRL/FetchReachSparse-v1", 2, substep=substep)
        assert envs.metadata["action_time"] == pytest.approx(time)
        agent = ppo(seed=0, num_envs=2, rollout_length=8, minibatches=1, epochs=1, discount_per="reference-action")
        envs.reset(seed=0)
        next(agent.train(envs, budget=16))
        assert agent.learner.config.gamma == pytest.approx(0.99**time)


@pytest.mark.parametrize("agent", [ppo, icm, eco, sprl, rnd])
def test_both_discounts_are_presets_of_fetch(agent: Any) -> None:
    per_action, per_time = (agent.hyperparameters("fetch", {}, preset) for preset in ("per-action", "table"))
    assert per_time == {**per_action, "discount_per": "reference-action"}
    assert per_action["discount_per"] == "action"
