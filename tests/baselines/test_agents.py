"""Agents and their factories: the contract with the harness, and resuming bit for bit."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar

import gymnasium
import numpy as np
import pytest
import torch
from gymnasium import spaces
from gymnasium.vector import VectorEnv
from torch import Tensor

from sprl_baselines.agents import LearningAgent, LearningAgentFactory, eco, gt_grid, gt_sprl, icm, ppo, sprl
from sprl_baselines.bonus import NoBonus, NoBonusConfig
from sprl_baselines.learning.moments import RewardNormalizer
from sprl_baselines.learning.rollout import Rollout
from sprl_baselines.ppo import PPO
from sprl_baselines.random_policy import random
from sprl_bench import checkpoint
from sprl_bench.actions import uniform_actions
from sprl_bench.agents import Resumable, load_factory, resolve_hyperparameters

GRID = "SPRL/FourRooms-7x7-v1"
SMALL: dict[str, Any] = {"num_envs": 4, "rollout_length": 32, "epochs": 2, "minibatches": 2}
FACTORIES: dict[str, Any] = {
    "eco": eco,
    "gt-grid": gt_grid,
    "gt-sprl": gt_sprl,
    "icm": icm,
    "ppo": ppo,
    "random": random,
    "sprl": sprl,
}
LEARNED: dict[str, Any] = {
    **SMALL,
    "replay_size": 240,
    "train_every": 128,
    "pair_batch": 8,
    "ready_trainings": 1,
    "ready_accuracy": 0.0,
}
QUICK: dict[str, dict[str, Any]] = {
    "eco": LEARNED,
    "gt-grid": SMALL,
    "gt-sprl": SMALL,
    "icm": {**SMALL, "icm_epochs": 2, "icm_minibatches": 2},
    "ppo": SMALL,
    "random": {"num_envs": 4},
    "sprl": LEARNED,
}
STEPS_PER_UPDATE = {name: 4 * (256 if name == "random" else 32) for name in FACTORIES}
PRIVILEGED = {"gt-grid", "gt-sprl"}
every_agent = pytest.mark.parametrize("name", sorted(FACTORIES))


def grid_envs(seed: int = 0, num_envs: int = 4) -> VectorEnv[Any, Any, Any]:
    envs = gymnasium.make_vec(GRID, num_envs=num_envs)
    envs.reset(seed=seed)
    return envs


def leaves(state: Any) -> list[Any]:
    """Return everything in a state that is no mapping; its keys must be strings."""
    if isinstance(state, Mapping):
        assert all(type(key) is str for key in state)
        return [leaf for value in state.values() for leaf in leaves(value)]
    return [state]


# ------------------------------------------------------------------------------------------ training


@every_agent
def test_training_takes_the_budget_and_reports_finite_numbers(name: str) -> None:
    envs = grid_envs()
    steps = 0
    step = envs.step

    def counted(actions: Any) -> Any:
        nonlocal steps
        steps += envs.num_envs
        return step(actions)

    envs.step = counted  # type: ignore[method-assign]
    agent = FACTORIES[name](seed=0, **QUICK[name])
    reports = list(agent.train(envs, 2 * STEPS_PER_UPDATE[name] + 1))
    assert len(reports) == 3
    assert steps == 3 * STEPS_PER_UPDATE[name]
    assert all(np.isfinite(value) for report in reports for value in report.values())


@every_agent
def test_the_same_seed_gives_the_same_run(name: str) -> None:
    states = []
    for seed in (5, 5, 6):
        agent = FACTORIES[name](seed=seed, **QUICK[name])
        envs = grid_envs()
        list(agent.train(envs, 2 * STEPS_PER_UPDATE[name]))
        states.append([bytes(np.asarray(array)) for array in envs.get_state().values()])  # type: ignore[attr-defined]
    assert states[0] == states[1]
    assert states[0] != states[2]


@every_agent
def test_a_run_resumed_from_a_file_goes_on_bit_for_bit(name: str, tmp_path: Path) -> None:
    budget = 5 * STEPS_PER_UPDATE[name]
    envs, agent = grid_envs(), FACTORIES[name](seed=0, **QUICK[name])
    assert isinstance(agent, Resumable)
    reports = []
    for update, report in enumerate(agent.train(envs, budget)):
        reports.append(dict(report))
        if update == 1:
            state = {"agent": agent.state_dict(), "envs": envs.get_state()}  # type: ignore[attr-defined]
            checkpoint.save(tmp_path / "state", state)

    loaded = checkpoint.load(tmp_path / "state")
    later_envs, later = grid_envs(seed=9), FACTORIES[name](seed=0, **QUICK[name])
    later_envs.set_state(loaded["envs"])  # type: ignore[attr-defined]
    later.load_state_dict(loaded["agent"])
    assert [dict(report) for report in later.train(later_envs, budget)] == reports[2:]
    for ours, theirs in zip(leaves(later.state_dict()), leaves(agent.state_dict()), strict=True):
        assert np.array_equal(ours, theirs), "the states differ at the end"
    for ours, theirs in zip(leaves(later_envs.get_state()), leaves(envs.get_state()), strict=True):  # type: ignore[attr-defined]
        assert np.array_equal(ours, theirs), "the envs differ at the end"


@every_agent
def test_a_state_is_plain(name: str) -> None:
    agent = FACTORIES[name](seed=0, **QUICK[name])
    next(agent.train(grid_envs(), 10_000))
    kinds = {type(leaf) for leaf in leaves(agent.state_dict())}
    assert kinds <= {Tensor, np.ndarray, int, float, bool, str, type(None)}


@every_agent
def test_a_closed_run_leaves_a_usable_state(name: str) -> None:
    agent = FACTORIES[name](seed=0, **QUICK[name])
    run = agent.train(grid_envs(), 10**9)
    next(run)
    run.close()
    assert agent.state_dict()["steps"] == STEPS_PER_UPDATE[name]


@pytest.mark.parametrize("env_id", [GRID, "Pendulum-v1"])
def test_a_restored_policy_acts_as_it_did_in_training(env_id: str) -> None:
    """From the same observations, drawn by the same generator: from a whole state and from the weights alone."""
    envs = gymnasium.make_vec(
        env_id, num_envs=4, vectorization_mode="sync", vector_kwargs={"autoreset_mode": "SameStep"}
    )
    envs.reset(seed=0)
    agent = ppo(seed=3, **SMALL, mlp_layers=1, mlp_units=8)
    next(agent.train(envs, 1000))
    spaces_ = envs.single_observation_space, envs.single_action_space
    played = []
    for state in (agent.state_dict(), agent.weights()):
        other = ppo(seed=3, **SMALL, mlp_layers=1, mlp_units=8)
        other.load_state_dict(state)
        policy = other.policy(*spaces_, seed=8)
        fresh = PPO(*spaces_, agent.config, 8, torch.device("cpu"))
        fresh.network.load_state_dict(agent.learner.network.state_dict())
        for observation in envs.reset(seed=1)[0]:
            action = policy(observation)
            assert spaces_[1].contains(action)
            drawn = fresh.policy()(torch.from_numpy(observation[None])).actions[0].detach().numpy()
            assert np.array_equal(action, drawn if env_id == GRID else drawn.clip(-2, 2))
            played.append(action)
    assert len(np.unique(played, axis=0)) > 1


def test_there_is_no_state_before_training() -> None:
    spaces_ = grid_envs().single_observation_space, spaces.Discrete(7)
    for ask in (ppo(seed=0).state_dict, ppo(seed=0).weights, lambda: ppo(seed=0).policy(*spaces_, seed=0)):
        with pytest.raises(RuntimeError, match="before train"):
            ask()


def test_envs_of_another_number_are_refused() -> None:
    with pytest.raises(ValueError, match="num_envs of the vector env is 3; it must be 4"):
        next(ppo(seed=0, **SMALL).train(grid_envs(num_envs=3), 1000))


class OneEach(NoBonus):
    """Pays 1 for every step, and says when it is trained."""

    privileged: ClassVar[bool] = True

    def reward(self, rollout: Rollout) -> Tensor:
        return torch.ones_like(rollout.rewards)

    def update(self, rollout: Rollout) -> Mapping[str, float]:
        return {"own_loss": 0.25}


def test_ppo_learns_from_reward_plus_bonus(monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[tuple[Tensor, Tensor, float]] = []
    update = PPO.update

    def spy(self: PPO, rollout: Rollout, training_rewards: Tensor, remaining: float = 1.0) -> dict[str, float]:
        seen.append((rollout.rewards, training_rewards, remaining))
        return update(self, rollout, training_rewards, remaining)

    monkeypatch.setattr(PPO, "update", spy)
    factory = LearningAgentFactory("ones", OneEach, NoBonusConfig, privileged=True)
    reports = list(factory(seed=0, **SMALL).train(grid_envs(), 4 * 128))
    for rewards, training_rewards, _ in seen:
        assert torch.equal(training_rewards, rewards + 1)
    assert [remaining for *_, remaining in seen] == [1.0, 0.75, 0.5, 0.25]
    assert [(report["bonus"], report["own_loss"]) for report in reports] == [(1.0, 0.25)] * 4


@pytest.mark.parametrize("kind", ["none", "extrinsic"])
def test_rewards_are_normalised_without_the_bonus(kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[tuple[Tensor, Tensor, Tensor]] = []
    update = PPO.update

    def spy(self: PPO, rollout: Rollout, training_rewards: Tensor, remaining: float = 1.0) -> dict[str, float]:
        seen.append((rollout.rewards, training_rewards, rollout.ended))
        return update(self, rollout, training_rewards, remaining)

    monkeypatch.setattr(PPO, "update", spy)
    agent = LearningAgentFactory("ones", OneEach, NoBonusConfig)(seed=0, **SMALL, reward_normalization=kind, gamma=0.9)
    deviations = [report["reward_deviation"] for report in agent.train(grid_envs(), 20 * 128)]
    alone = RewardNormalizer(4, 0.9, torch.device("cpu"))
    for (rewards, training_rewards, ended), deviation in zip(seen, deviations, strict=True):
        expected = {"none": rewards + 1, "extrinsic": alone(rewards, ended) + 1}
        assert torch.equal(training_rewards, expected[kind])
        assert deviation == {"none": 1.0, "extrinsic": alone.deviation}[kind]
    assert (deviations[-1] == 1.0) == (kind == "none")


def test_a_run_with_normalised_rewards_resumes() -> None:
    first, second = (ppo(seed=0, **SMALL, reward_normalization="extrinsic") for _ in range(2))
    envs, later = grid_envs(), grid_envs()
    run = first.train(envs, 3 * 128)
    next(run)
    second.load_state_dict(first.state_dict())
    later.set_state(envs.get_state())  # type: ignore[attr-defined]
    assert [dict(report) for report in run] == [dict(report) for report in second.train(later, 3 * 128)]
    ours, theirs = (leaves(made.state_dict()["normalizer"]) for made in (first, second))
    assert all(np.array_equal(*pair) for pair in zip(ours, theirs, strict=True))


def test_a_rollout_is_priced_before_the_policy_and_the_bonus_learn_from_it(monkeypatch: pytest.MonkeyPatch) -> None:
    order = []

    class Telling(NoBonus):
        def reward(self, rollout: Rollout) -> Tensor:
            order.append("reward")
            return super().reward(rollout)

        def update(self, rollout: Rollout) -> Mapping[str, float]:
            order.append("bonus")
            return super().update(rollout)

    update = PPO.update
    monkeypatch.setattr(PPO, "update", lambda *arguments: order.append("policy") or update(*arguments))  # type: ignore[func-returns-value]
    list(LearningAgentFactory("telling", Telling, NoBonusConfig)(seed=0, **SMALL).train(grid_envs(), 256))
    assert order == ["reward", "policy", "bonus"] * 2


def test_every_source_of_chance_follows_from_the_seed_and_no_two_are_one() -> None:
    seeds = []
    for seed in (0, 1):
        agent: Any = sprl(seed=seed, **SMALL)
        next(agent.train(grid_envs(), 128))
        drawing = (agent.learner, agent.bonus.reachability, agent._collector)
        seeds += [made._generator.initial_seed() for made in drawing]
    assert len(set(seeds)) == 6


def pendulums() -> VectorEnv[Any, Any, Any]:
    envs = gymnasium.make_vec(
        "Pendulum-v1", num_envs=4, vectorization_mode="sync", vector_kwargs={"autoreset_mode": "SameStep"}
    )
    envs.reset(seed=0)
    return envs


def test_the_action_noise_of_the_settings_is_that_of_the_rollouts() -> None:
    agent: Any = ppo(seed=0, **SMALL, mlp_layers=1, mlp_units=8, action_noise=0.3)
    next(agent.train(pendulums(), 128))
    assert agent._collector._action_noise == 0.3


def test_flat_observations_and_continuous_actions_are_learned_from() -> None:
    envs = pendulums()
    agent = ppo(seed=0, **SMALL, mlp_layers=1, mlp_units=8)
    reports = list(agent.train(envs, 256))
    assert len(reports) == 2
    assert all(np.isfinite(value) for report in reports for value in report.values())


SCALES = {
    "eco": "bonus_weight",
    "gt-grid": "bonus_weight",
    "gt-sprl": "cost_scale",
    "icm": "bonus_weight",
    "sprl": "cost_scale",
}


@pytest.mark.parametrize("name", sorted(SCALES))
def test_the_scale_of_a_bonus_reaches_the_learner_and_nothing_else(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """With a learner that learns nothing, what the environment pays is the same, whatever the bonus pays."""
    streams: dict[float, list[tuple[Tensor, Tensor, Tensor]]] = {0.0: [], 1.0: [], 2.0: []}
    for scale, stream in streams.items():

        def keep(_: PPO, rollout: Rollout, training_rewards: Tensor, remaining: float, stream: Any = stream) -> Any:
            stream.append((rollout.rewards, rollout.actions, training_rewards))
            return {}

        monkeypatch.setattr(PPO, "update", keep)
        list(FACTORIES[name](seed=0, **{**QUICK[name], SCALES[name]: scale}).train(grid_envs(), 8 * 128))
    for nothing, once, twice in zip(*streams.values(), strict=True):
        for own in range(2):
            assert torch.equal(nothing[own], once[own])
            assert torch.equal(nothing[own], twice[own])
        rewards, bonus = nothing[0], once[2] - once[0]
        assert torch.equal(nothing[2], rewards)
        assert torch.allclose(twice[2], rewards + 2 * bonus, atol=1e-5)
    assert (once[2] != once[0]).any()


def test_minibatches_beyond_the_rollout_are_refused_before_anything_is_run() -> None:
    with pytest.raises(
        ValueError, match=r"icm_minibatches is 1537; it must be at most num_envs \* rollout_length, 1536"
    ):
        FACTORIES["icm"].hyperparameters("grid", {"icm_minibatches": 1537})


@pytest.mark.parametrize("name", ["eco", "gt-grid", "gt-sprl", "icm", "ppo", "sprl"])
def test_every_agent_can_see_earlier_observations_too(name: str) -> None:
    """The policy does; what its bonus sees is checked against the true successors of the newest ones."""
    agent = FACTORIES[name](seed=0, **QUICK[name], stack=2)
    reports = list(agent.train(grid_envs(), 3 * STEPS_PER_UPDATE[name]))
    assert agent.learner.network.policy_trunk[1].weights[0].shape[1] == 9
    assert all(np.isfinite(value) for report in reports for value in report.values())
    with pytest.raises(ValueError, match="stack is 2; it must be 0 to act on one observation"):
        agent.policy(spaces.Discrete(2), spaces.Discrete(2), seed=0)


def test_a_bonus_sees_each_observation_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    shapes = []

    class Looking(OneEach):
        def reward(self, rollout: Rollout) -> Tensor:
            shapes.append(tuple(rollout.observations.shape[2:]))
            return super().reward(rollout)

    next(LearningAgentFactory("looking", Looking, NoBonusConfig)(seed=0, **SMALL, stack=3).train(grid_envs(), 128))
    assert shapes == [(7, 7, 3)]


# ----------------------------------------------------------------------------------------- factories


@every_agent
def test_the_installed_name_leads_to_the_factory(name: str) -> None:
    assert load_factory(name) is FACTORIES[name]
    assert FACTORIES[name].privileged is (name in PRIVILEGED)


@every_agent
def test_resolved_hyperparameters_are_whole_plain_and_stable(name: str) -> None:
    factory = FACTORIES[name]
    resolved = resolve_hyperparameters(factory, "grid", {"num_envs": 6})
    assert resolved.values["num_envs"] == resolved.num_envs == 6
    assert resolved.differences == {"num_envs": 6}
    assert json.loads(json.dumps(resolved.values)) == resolved.values
    assert resolve_hyperparameters(factory, "grid", resolved.values) == resolved
    factory(seed=0, **resolved.values)


@every_agent
def test_a_wrong_hyperparameter_is_refused_when_resolved_and_when_made(name: str) -> None:
    factory = FACTORIES[name]
    for wrong, complaint in (
        ({"num_env": 3}, r"Unknown hyperparameter 'num_env'; did you mean 'num_envs'\?"),
        ({"num_envs": 0}, r"num_envs is 0; it must be a whole number, at least 1"),
        ({"num_envs": "many"}, r"num_envs is 'many'; it must be a whole number"),
    ):
        with pytest.raises(ValueError, match=complaint):
            factory.hyperparameters("grid", wrong)
        with pytest.raises(ValueError, match=complaint):
            factory(seed=0, **wrong)


def test_an_agent_that_no_preset_names_keeps_its_defaults() -> None:
    mine = LearningAgentFactory("mine", OneEach, NoBonusConfig)
    assert mine.hyperparameters("fetch", {}) == mine.hyperparameters("grid", {}) == ppo.hyperparameters("grid", {})


def test_unknown_domains_and_presets_are_refused() -> None:
    with pytest.raises(ValueError, match=r"Unknown domain 'gird'; did you mean 'grid'\?"):
        ppo.hyperparameters("gird", {})
    with pytest.raises(ValueError, match=r"Unknown preset of domain 'grid': 'tabel'; did you mean 'table'\?"):
        ppo.hyperparameters("grid", {}, "tabel")


def test_resolving_leaves_the_overrides_alone() -> None:
    overrides = {"epochs": 1}
    ppo.hyperparameters("grid", overrides)
    assert overrides == {"epochs": 1}


def test_making_an_agent_computes_nothing_yet() -> None:
    agent = ppo(seed=0)
    assert isinstance(agent, LearningAgent)
    assert not hasattr(agent, "learner")


# ------------------------------------------------------------------------------------ random agent


def test_the_random_agent_needs_no_torch() -> None:
    code = "import sys, sprl_baselines.random_policy as m; m.random(seed=0); print('torch' in sys.modules)"
    shown = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert shown.strip() == "False"


def test_uniform_actions_cover_their_space_evenly() -> None:
    generator = np.random.default_rng(0)
    discrete = uniform_actions(spaces.Discrete(4, start=2), 8000, generator)
    shares = np.bincount(discrete, minlength=6) / 8000
    np.testing.assert_allclose(shares, [0, 0, 0.25, 0.25, 0.25, 0.25], atol=0.02)  # four standard errors
    box = spaces.Box(np.float32([-1, 2]), np.float32([1, 6]))
    drawn = uniform_actions(box, 8000, generator)
    assert drawn.dtype == np.float32
    assert drawn.min(axis=0) == pytest.approx([-1, 2], abs=0.01)
    assert drawn.max(axis=0) == pytest.approx([1, 6], abs=0.01)
    assert drawn.mean(axis=0) == pytest.approx([0, 4], abs=0.06)


@pytest.mark.parametrize("space", [spaces.Box(-np.inf, np.inf, (2,)), spaces.MultiDiscrete([2, 2])])
def test_spaces_without_a_uniform_policy_are_refused(space: Any) -> None:
    with pytest.raises(ValueError, match=r"action_space is .*; it must be Discrete or a bounded Box"):
        uniform_actions(space, 1, np.random.default_rng(0))
