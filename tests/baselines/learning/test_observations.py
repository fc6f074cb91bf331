"""What networks see of an observation: running moments, frozen between updates, and part of every network's state."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
import torch
from gymnasium import spaces
from gymnasium.vector import VectorWrapper
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from torch.testing import assert_close

from sprl_baselines.agents import LearningAgent, icm, ppo, sprl
from sprl_baselines.learning.observations import NormalizedObservations, RawObservations, view_of
from sprl_bench import checkpoint

REACH = "SPRL/FetchReachSparse-v1"
NORMALIZED: dict[str, Any] = {
    "num_envs": 2, "rollout_length": 32, "epochs": 1, "minibatches": 2, "normalize_observations": True
}  # fmt: skip
NETWORK: dict[str, Any] = {
    "k": 2, "negative_bias": 3, "replay_size": 120, "train_every": 64, "pair_batch": 8, "tolerance_samples": 3,
    "ready_trainings": 1, "ready_accuracy": 0.0,
}  # fmt: skip
values = arrays(np.float64, (12, 3), elements=st.floats(-1e3, 1e3))


def view_after(*batches: Any, clip: float = 5.0) -> NormalizedObservations:
    view = NormalizedObservations(3, clip)
    for batch in batches:
        view.update(torch.as_tensor(batch))
    return view


@given(values, st.integers(1, 11))
def test_moments_are_those_of_everything_seen_however_it_is_cut(seen: Any, cut: int) -> None:
    view = view_after(seen[:cut], seen[cut:])
    assert_close(view.mean.numpy(), seen.mean(axis=0), rtol=1e-9, atol=1e-9)
    assert_close(view.deviation.numpy(), np.sqrt(seen.var(axis=0) + 1e-8), rtol=1e-6, atol=1e-9)
    assert int(view.count) == 12


def test_a_batch_of_rollouts_is_seen_step_by_step_and_env_by_env() -> None:
    seen = np.random.default_rng(0).normal(size=(4, 5, 3))
    assert_close(view_after(seen).mean, view_after(seen.reshape(20, 3)).mean)


def test_what_is_seen_has_zero_mean_and_unit_deviation_and_no_outliers() -> None:
    seen = torch.from_numpy(np.random.default_rng(1).normal((1.3, 0.75, 0.5), (0.15, 0.01, 1e-4), size=(4000, 3)))
    shown = view_after(seen)(seen)
    assert shown.dtype is torch.float32
    assert_close(shown.mean(dim=0), torch.zeros(3), atol=1e-3, rtol=0)
    assert_close(shown[:, :2].std(dim=0), torch.ones(2), atol=2e-3, rtol=0)
    assert float(view_after(seen, clip=2.0)(seen).abs().max()) == 2.0


def test_nothing_changes_between_two_updates_and_before_the_first() -> None:
    view = view_after()
    assert_close(view(torch.tensor([[1.0, -2.0, 9.0]])), torch.tensor([[1.0, -2.0, 5.0]]))
    view.update(torch.randn(10, 3))
    before = view(torch.ones(1, 3))
    view(torch.full((50, 3), 7.0))
    assert_close(view(torch.ones(1, 3)), before, rtol=0, atol=0)


def test_raw_observations_are_cast_where_they_are_flat() -> None:
    raw = RawObservations()
    assert raw(torch.ones(2, 3, dtype=torch.float64)).dtype is torch.float32
    assert raw(torch.ones(2, 7, 7, 3, dtype=torch.uint8)).dtype is torch.uint8


def test_only_flat_observations_can_be_normalised() -> None:
    grid = spaces.Box(0, 255, (7, 7, 3), np.uint8)
    assert isinstance(view_of(grid, normalize=False, clip=5.0), RawObservations)
    with pytest.raises(ValueError, match="normalize_observations is True; it must be False where observations are in"):
        view_of(grid, normalize=True, clip=5.0)
    with pytest.raises(ValueError, match="stack is 2; it must be 0 where normalize_observations is true"):
        ppo(seed=0, **NORMALIZED, stack=2)


def reach(num_envs: int = 2) -> Any:
    pytest.importorskip("mujoco")
    envs = gymnasium.make_vec(REACH, num_envs, substep=20)
    envs.reset(seed=3)
    return envs


def trained(agent: LearningAgent, updates: int, envs: Any = None) -> list[dict[str, float]]:
    steps = agent.train(reach() if envs is None else envs, budget=10_000)
    return [next(steps) for _ in range(updates)]


@pytest.mark.parametrize("agent", [icm(seed=0, **NORMALIZED), sprl(seed=0, **NORMALIZED, **NETWORK)])
def test_every_network_of_an_agent_sees_by_one_view(agent: LearningAgent) -> None:
    trained(agent, 3)
    network = agent.bonus.network if hasattr(agent.bonus, "network") else agent.bonus.reachability.network
    views = [module for module in (agent.learner.network, network) for module in module.modules()]
    assert len({id(one) for one in views if isinstance(one, NormalizedObservations)}) == 1
    assert int(agent.learner.network.view.count) == 3 * 64


@pytest.mark.parametrize("factory", [icm, ppo, sprl])
def test_a_resumed_run_sees_by_the_very_moments(factory: Any, tmp_path: Path) -> None:
    settings = {**NORMALIZED, **(NETWORK if factory is sprl else {})}
    whole = trained(factory(seed=1, **settings), 5)
    envs, first = reach(), factory(seed=1, **settings)
    assert trained(first, 3, envs) == whole[:3]
    checkpoint.save(tmp_path / "state", {"agent": first.state_dict()})
    second = factory(seed=1, **settings)
    second.load_state_dict(checkpoint.load(tmp_path / "state")["agent"])
    assert trained(second, 2, envs) == whole[3:]


def test_a_played_policy_sees_by_the_moments_of_its_training() -> None:
    agent = ppo(seed=0, **NORMALIZED)
    envs = reach()
    trained(agent, 2, envs)
    player = ppo(seed=0, **NORMALIZED)
    player.load_state_dict(agent.weights())
    policy = player.policy(envs.single_observation_space, envs.single_action_space, seed=9)
    twin = agent.policy(envs.single_observation_space, envs.single_action_space, seed=9)
    observation = envs.single_observation_space.sample()
    np.testing.assert_array_equal(policy(observation), twin(observation))


def test_weights_without_the_moments_that_they_need_are_refused() -> None:
    envs, plain = reach(), {**NORMALIZED, "normalize_observations": False}
    spaces_ = envs.single_observation_space, envs.single_action_space
    for trained_with, played_with, fault in ((plain, NORMALIZED, "lack view."), (NORMALIZED, plain, "hold view.")):
        agent, player = ppo(seed=0, **trained_with), ppo(seed=0, **played_with)
        trained(agent, 1)
        player.load_state_dict(agent.weights())
        with pytest.raises(ValueError, match=f"The weights {fault}"):
            player.policy(*spaces_, seed=0)


class Diverging(VectorWrapper[Any, Any, Any]):
    """Shows a number that is not finite in one sub-env at one step."""

    def __init__(self, envs: Any, step: int, env: int, value: float) -> None:
        super().__init__(envs)
        self._left, self._env, self._value = step, env, value

    def step(self, actions: Any) -> Any:
        observations, *rest = self.env.step(actions)
        self._left -= 1
        if self._left == 0:
            observations = observations.copy()
            observations[self._env, 4] = self._value
        return observations, *rest


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("step", [1, 5, 40])
def test_an_observation_that_is_not_finite_stops_the_run_and_is_named(value: float, step: int) -> None:
    envs = Diverging(reach(), step, 1, value)
    with pytest.raises(ValueError, match=f"observation of sub-environment 1 after its step {step} is not finite"):
        trained(ppo(seed=0, **NORMALIZED), 2, envs)
