"""Discounts per action or per simulated time."""

from __future__ import annotations

from typing import Any

import gymnasium
import pytest

import sprl_bench  # noqa: F401 - registers the ids
from sprl_baselines.agents import eco, icm, ppo, rnd, sprl
from sprl_baselines.ppo import PPOConfig
from sprl_baselines.sprl import SPRLConfig


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
    timed = [name for name in per_time if name in ("discount_per", "cost_per")]
    assert per_time == {**per_action, **dict.fromkeys(timed, "reference-action")}
    assert {per_action[name] for name in timed} == {"action"}
    assert ("cost_per" in timed) == (agent is sprl)


def test_never_violating_is_worth_less_than_the_goal_on_fetch() -> None:
    config = sprl.hyperparameters("fetch", {})
    for substep in (2, 3, 8, 20):
        gamma = PPOConfig.pick(config).timed(substep / 20).gamma
        income = SPRLConfig.pick(config).scale(substep / 20) * config["bias"]
        assert income / (1 - gamma) < 0.6 * config["reward_clip"]
