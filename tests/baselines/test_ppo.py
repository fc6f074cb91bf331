"""The learner: its losses against hand-computed numbers, its update against a plain one, its determinism."""

from __future__ import annotations

import random
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch
from gymnasium import spaces
from torch import Tensor

from sprl_baselines.learning.rollout import Rollout, Rows
from sprl_baselines.ppo import PPO, PPOConfig, Samples, ppo_losses

GRID = spaces.Box(0, 255, (7, 7, 3), np.uint8)
CPU = torch.device("cpu")
PLAIN = PPOConfig()


def batch(
    *,
    advantages: list[float],
    old_log_probs: list[float] | None = None,
    values: list[float] | None = None,
    returns: list[float] | None = None,
) -> Samples:
    zeros = [0.0] * len(advantages)
    return Samples(
        observations=Rows.of(torch.zeros(len(advantages), 1)),
        actions=torch.zeros(len(advantages), dtype=torch.int64),
        log_probs=torch.tensor(old_log_probs or zeros),
        values=torch.tensor(values or zeros),
        advantages=torch.tensor(advantages),
        returns=torch.tensor(returns or zeros),
    )


def losses(samples: Samples, config: PPOConfig = PLAIN, **given: list[float]) -> dict[str, float]:
    zeros = [0.0] * len(samples.advantages)
    now = {name: torch.tensor(given.get(name, zeros)) for name in ("log_probs", "values", "entropy")}
    return {name: loss.item() for name, loss in ppo_losses(**now, batch=samples, clip_range=0.2, config=config).items()}


# ------------------------------------------------------------------------------------------- losses


def test_the_surrogate_is_clipped_on_both_sides() -> None:
    samples = batch(advantages=[1.0, 1.0, -1.0, -1.0])
    log_probs = torch.tensor([1.5, 0.5, 1.5, 0.5]).log().requires_grad_()
    found = ppo_losses(log_probs, torch.zeros(4), torch.zeros(4), samples, 0.2, PLAIN)
    # min(1.5, 1.2), min(0.5, 0.8), min(-1.5, -1.2), min(-0.5, -0.8)
    assert found["policy_loss"].item() == pytest.approx(-(1.2 + 0.5 - 1.5 - 0.8) / 4)
    found["loss"].backward()
    # d/d(log ratio) of -ratio * advantage / 4 where unclipped, nothing where clipped
    assert log_probs.grad is not None
    torch.testing.assert_close(log_probs.grad, torch.tensor([0.0, -0.125, 0.375, 0.0]))


def test_within_the_range_nothing_is_clipped() -> None:
    found = losses(batch(advantages=[2.0, -3.0]), log_probs=np.log([1.1, 0.9]).tolist())
    assert found["policy_loss"] == pytest.approx(-(2.2 - 2.7) / 2, rel=1e-5)
    assert found["clipped_share"] == 0.0


def test_measures_of_movement() -> None:
    found = losses(batch(advantages=[0.0, 0.0]), log_probs=np.log([1.5, 1.1]).tolist())
    assert found["clipped_share"] == 0.5
    expected = ((1.5 - 1 - np.log(1.5)) + (1.1 - 1 - np.log(1.1))) / 2
    assert found["approximate_kl"] == pytest.approx(expected, rel=1e-4)


def test_the_value_loss_takes_the_worse_of_plain_and_clipped() -> None:
    samples = batch(advantages=[0.0, 0.0], values=[0.0, 0.0], returns=[1.0, 1.0])
    now = [0.5, -0.5]  # clipped to 0.2 and -0.2: errors 0.25 or 0.64, and 2.25 or 1.44
    assert losses(samples, values=now)["value_loss"] == pytest.approx(0.5 * (0.64 + 2.25) / 2)
    without = replace(PLAIN, clip_value=False)
    assert losses(samples, without, values=now)["value_loss"] == pytest.approx(0.5 * (0.25 + 2.25) / 2)


def test_advantages_are_normalised_within_the_minibatch() -> None:
    samples = batch(advantages=[1.0, 3.0])  # mean 2, unbiased deviation sqrt 2
    found = losses(samples.normalized(), log_probs=np.log([1.1, 1.0]).tolist())
    assert found["policy_loss"] == pytest.approx(-(1.1 * -(0.5**0.5) + 0.5**0.5) / 2, rel=1e-5)


def test_a_single_advantage_is_left_as_it_is() -> None:
    assert losses(batch(advantages=[3.0]).normalized())["policy_loss"] == -3.0


def test_the_loss_weighs_its_parts() -> None:
    samples = batch(advantages=[1.0], returns=[0.1])
    config = replace(PLAIN, value_coefficient=0.5, entropy_coefficient=0.25)
    found = losses(samples, config, entropy=[2.0])
    assert found["loss"] == pytest.approx(-1.0 + 0.5 * (0.5 * 0.01) - 0.25 * 2.0)
    assert found["entropy"] == 2.0


# ------------------------------------------------------------------------------------------- update


def made_up_rollout(steps: int = 16, envs: int = 4, seed: int = 0, repeats: bool = True) -> Rollout:
    """Return steps with a few endings; with `repeats`, only six different observations."""
    generator = torch.Generator().manual_seed(seed)

    def chance(share: float) -> Tensor:
        return torch.rand(steps, envs, generator=generator) < share

    pool = torch.randint(0, 4, (6 if repeats else steps * envs, 7, 7, 3), generator=generator).to(torch.uint8)
    order = torch.randint(len(pool), (steps, envs), generator=generator)
    terminated, truncated = chance(0.1), chance(0.1)
    return Rollout(
        observations=pool[order],
        actions=torch.randint(7, (steps, envs), generator=generator),
        rewards=torch.rand(steps, envs, generator=generator),
        terminated=terminated,
        truncated=truncated,
        values=torch.randn(steps, envs, generator=generator) * 0.1,
        log_probs=torch.full((steps, envs), 1 / 7).log(),
        last_observations=pool[:envs],
        final_observations=pool[torch.zeros(int((terminated | truncated).sum()), dtype=torch.int64)],
        positions=torch.zeros(steps, envs, 2, dtype=torch.int64),
        next_positions=torch.zeros(steps, envs, 2, dtype=torch.int64),
    )


def learner(seed: int = 0, **hyperparameters: Any) -> PPO:
    config = PPOConfig(**{"num_envs": 4, "rollout_length": 16, **hyperparameters})
    return PPO(GRID, spaces.Discrete(7), config, seed, CPU)


def plain_update(ppo: PPO, rollout: Rollout, rewards: Tensor) -> None:
    """Do what one update does, with torch's own parts and every observation computed every time."""
    config, network = ppo.config, ppo.network
    values, advantages, carry = rollout.values, torch.zeros_like(rewards), torch.zeros(rewards.shape[1])
    with torch.no_grad():
        following = network.values(rollout.last_observations)
    for t in reversed(range(len(rewards))):
        goes_on = (~(rollout.terminated[t] | rollout.truncated[t])).float()
        error = rewards[t] + config.gamma * goes_on * following - values[t]
        advantages[t] = carry = error + config.gamma * config.gae_lambda * goes_on * carry
        following = values[t]
    observations, actions = rollout.observations.flatten(0, 1), rollout.actions.flatten()
    returns, old = (advantages + values).flatten(), rollout.log_probs.flatten()
    optimizer = torch.optim.Adam(network.parameters(), lr=config.learning_rate, eps=config.adam_epsilon)
    generator = torch.Generator()
    generator.set_state(ppo.state_dict()["generator"])
    for _ in range(config.epochs):
        for chosen in torch.randperm(len(returns), generator=generator).chunk(config.minibatches):
            logits, now = network(observations[chosen])
            policy = torch.distributions.Categorical(logits=logits)
            ratio = (policy.log_prob(actions[chosen]) - old[chosen]).exp()
            gain = advantages.flatten()[chosen]
            gain = (gain - gain.mean()) / (gain.std() + 1e-8)
            clipped = ratio.clamp(1 - config.clip_range, 1 + config.clip_range)
            before = values.flatten()[chosen]
            held = before + (now - before).clamp(-config.clip_range, config.clip_range)
            errors = torch.maximum((now - returns[chosen]) ** 2, (held - returns[chosen]) ** 2)
            loss = (
                -torch.minimum(ratio * gain, clipped * gain).mean()
                + config.value_coefficient * 0.5 * errors.mean()
                - config.entropy_coefficient * policy.entropy().mean()
            )
            optimizer.zero_grad()
            loss.backward()
            torch.nn.utils.clip_grad_norm_(network.parameters(), config.max_grad_norm)
            optimizer.step()


@pytest.mark.parametrize(("repeats", "discounts"), [(True, {}), (False, {}), (True, {"gamma": 0.9, "gae_lambda": 0.5})])
def test_an_update_equals_a_plain_one(repeats: bool, discounts: dict[str, float]) -> None:
    rollout = made_up_rollout(repeats=repeats)
    ours, plain = (learner(learning_rate=1e-3, **discounts) for _ in range(2))
    plain_update(plain, rollout, rollout.rewards)
    ours.update(rollout, rollout.rewards)
    for mine, theirs in zip(ours.network.parameters(), plain.network.parameters(), strict=True):
        torch.testing.assert_close(mine, theirs, rtol=1e-3, atol=2e-5)


def test_an_update_writes_nothing_to_the_rollout() -> None:
    rollout, untouched = made_up_rollout(), made_up_rollout()
    learner().update(rollout, rollout.rewards)
    for name in Rollout.__dataclass_fields__:
        assert torch.equal(getattr(rollout, name), getattr(untouched, name)), name


def test_what_follows_a_truncation_counts_only_on_request() -> None:
    rollout = made_up_rollout()
    rollout = replace(rollout, terminated=torch.zeros_like(rollout.terminated))
    rollout = replace(rollout, final_observations=rollout.final_observations[: int(rollout.truncated.sum())])
    found = {}
    for bootstrap in (False, True):
        samples = learner(bootstrap_on_truncation=bootstrap)._samples(rollout, rollout.rewards)
        found[bootstrap] = samples.returns.view_as(rollout.rewards)[rollout.truncated]
    torch.testing.assert_close(found[False], rollout.rewards[rollout.truncated])
    values = learner().network.values(rollout.final_observations).detach()
    torch.testing.assert_close(found[True], rollout.rewards[rollout.truncated] + 0.99 * values)


def test_annealing_follows_the_remaining_budget() -> None:
    rollout = made_up_rollout()
    annealed = learner().update(rollout, rollout.rewards, 0.25)
    assert (annealed["learning_rate"], annealed["clip_range"]) == pytest.approx((0.003 / 4, 0.2 / 4))
    constant = learner(anneal_learning_rate=False, anneal_clip_range=False).update(rollout, rollout.rewards, 0.25)
    assert (constant["learning_rate"], constant["clip_range"]) == (0.003, 0.2)


def test_the_gradient_is_cut_to_its_largest_norm() -> None:
    """Adam hides the length of a first gradient, but not in its second moment."""
    ppo, rollout = learner(max_grad_norm=1e-3, epochs=1, minibatches=1), made_up_rollout()
    assert ppo.update(rollout, 100 * rollout.rewards)["gradient_norm"] > 1e-3
    squares = sum(moment["exp_avg_sq"].sum().item() for moment in ppo.state_dict()["optimizer"].values())
    assert (squares / 0.001) ** 0.5 == pytest.approx(1e-3, rel=1e-2)


def test_metrics_are_finite_numbers() -> None:
    rollout = made_up_rollout()
    metrics = learner().update(rollout, rollout.rewards)
    assert {"policy_loss", "value_loss", "entropy", "approximate_kl", "explained_variance"} <= set(metrics)
    assert "loss" not in metrics
    assert all(isinstance(value, float) and np.isfinite(value) for value in metrics.values())


def test_perfect_values_explain_everything() -> None:
    rollout = made_up_rollout()
    rollout = replace(rollout, rewards=torch.zeros_like(rollout.rewards), values=torch.zeros_like(rollout.values))
    rollout = replace(rollout, terminated=torch.ones_like(rollout.terminated))
    finals = rollout.observations.flatten(0, 1)
    varied = torch.arange(64.0).view(16, 4)
    fitted = replace(rollout, values=varied, final_observations=finals)
    assert learner().update(fitted, varied)["explained_variance"] == pytest.approx(1.0)
    constant = replace(rollout, final_observations=finals)
    assert learner().update(constant, rollout.rewards)["explained_variance"] == 0.0


# -------------------------------------------------------------------------------------- determinism


def bits(ppo: PPO) -> list[bytes]:
    return [value.numpy().tobytes() for value in ppo.network.state_dict().values()]


def test_same_seed_same_bits_and_no_global_generator_is_touched() -> None:
    before = torch.get_rng_state(), np.random.get_state()[1], random.getstate()  # noqa: NPY002 - that it is untouched
    rollout, found = made_up_rollout(), []
    for seed in (3, 3, 4):
        ppo = learner(seed)
        decisions = [ppo.policy()(rollout.last_observations) for _ in range(3)]
        ppo.update(rollout, rollout.rewards)
        found.append((bits(ppo), [decision.actions.tolist() for decision in decisions]))
    assert found[0] == found[1]
    assert found[0][0] != found[2][0]
    assert torch.equal(torch.get_rng_state(), before[0])
    assert np.array_equal(np.random.get_state()[1], before[1])  # noqa: NPY002
    assert random.getstate() == before[2]


def test_a_saved_learner_goes_on_bit_for_bit() -> None:
    rollout = made_up_rollout()
    first = learner(1)
    first.update(rollout, rollout.rewards)
    second = learner(2)
    second.load_state_dict(first.state_dict())
    for ppo in (first, second):
        ppo.update(rollout, rollout.rewards)
    assert bits(first) == bits(second)
    assert torch.equal(
        first.policy()(rollout.last_observations).actions, second.policy()(rollout.last_observations).actions
    )


def test_a_saved_state_does_not_move_with_its_learner() -> None:
    rollout = made_up_rollout()
    ppo = learner()
    ppo.update(rollout, rollout.rewards)
    state = ppo.state_dict()
    kept = {name: value.clone() for name, value in state["network"].items()}
    moment = state["optimizer"]["0"]["exp_avg"].clone()
    ppo.update(rollout, rollout.rewards)
    assert all(torch.equal(state["network"][name], kept[name]) for name in kept)
    assert torch.equal(state["optimizer"]["0"]["exp_avg"], moment)
