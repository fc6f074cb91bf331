"""The contract of a bonus, over every bonus that an agent uses and one made up here."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, ClassVar

import gymnasium
import numpy as np
import pytest
import torch
from torch import Tensor

import sprl_bench  # noqa: F401 - registers the ids
from sprl_baselines import agents
from sprl_baselines.bonus import Bonus, NoBonusConfig, Setting
from sprl_baselines.learning.collector import Collector, Decision
from sprl_baselines.learning.rollout import Rollout

CPU = torch.device("cpu")
NUM_ENVS, LENGTH = 4, 150  # long enough for every sub-env to reach the time limit once
Maker = Callable[[Setting], Bonus]

# A network that may be trusted after one rollout, where a bonus has one: a bonus that pays nothing could break no rule.
ALREADY_PAYING = {"replay_size": 1000, "train_every": 1, "pair_batch": 16, "ready_trainings": 1, "ready_accuracy": 0.0}


class FirstVisits:
    """Pays 1 for each cell that is new in its episode: the smallest bonus with an episodic memory."""

    privileged: ClassVar[bool] = False

    def __init__(self, setting: Setting, config: NoBonusConfig) -> None:
        self._seen = torch.zeros(setting.num_envs, 7, 7, dtype=torch.bool)

    def reward(self, rollout: Rollout) -> Tensor:
        rewards = torch.zeros_like(rollout.rewards)
        env = torch.arange(rewards.shape[1])
        for step, (x, y) in enumerate(zip(*rollout.next_positions.unbind(-1), strict=True)):
            rewards[step] = (~self._seen[env, x, y]).float()
            self._seen[env, x, y] = True
            self._seen[rollout.ended[step]] = False
        return rewards

    def update(self, rollout: Rollout) -> Mapping[str, float]:
        return {}

    def state_dict(self) -> Mapping[str, Any]:
        return {"seen": self._seen.clone()}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        self._seen = state["seen"].clone()


class Forgetful(FirstVisits):
    """A mistake that the contract is there to find: memory ends with the rollout."""

    def reward(self, rollout: Rollout) -> Tensor:
        self._seen.zero_()
        return super().reward(rollout)


class Unforgetting(FirstVisits):
    """Another: memory goes on when an episode ends."""

    def reward(self, rollout: Rollout) -> Tensor:
        never = torch.zeros_like(rollout.ended)
        return super().reward(replace(rollout, terminated=never, truncated=never))


def _makers() -> dict[str, Maker]:
    factories = [value for value in vars(agents).values() if isinstance(value, agents.LearningAgentFactory)]
    makers: dict[str, Maker] = {
        factory.name: lambda setting, factory=factory: factory.bonus(setting, factory.bonus_config.pick(ALREADY_PAYING))
        for factory in factories
    }
    return {**makers, "made-up": lambda setting: FirstVisits(setting, NoBonusConfig())}


MAKERS = _makers()
every_bonus = pytest.mark.parametrize("name", sorted(MAKERS))


def uniform_policy(seed: int) -> Callable[[Tensor], Decision]:
    generator = torch.Generator().manual_seed(seed)

    def act(observations: Tensor) -> Decision:
        zeros = torch.zeros(len(observations))
        return Decision(torch.randint(7, (len(observations),), generator=generator), zeros, zeros)

    return act


@pytest.fixture(scope="module")
def stream() -> list[Rollout]:
    """Three rollouts of one stream."""
    envs = gymnasium.make_vec("SPRL/FourRooms-7x7-v1", num_envs=NUM_ENVS)
    envs.reset(seed=0)
    collector = Collector(envs, LENGTH, CPU)
    collector.reset()
    rollouts = [collector.collect(uniform_policy(seed)) for seed in range(3)]
    assert all(rollout.ended.any(dim=0).all() for rollout in rollouts)
    return rollouts


def make(name: str, seed: int = 0) -> Bonus:
    single = gymnasium.make("SPRL/FourRooms-7x7-v1")
    return MAKERS[name](Setting(single.observation_space, single.action_space, NUM_ENVS, seed, CPU))


def used(name: str, rollout: Rollout, seed: int = 0) -> Bonus:
    """Return a bonus that has been through one rollout."""
    bonus = make(name, seed)
    bonus.reward(rollout)
    bonus.update(rollout)
    return bonus


def cut(rollout: Rollout, at: int) -> tuple[Rollout, Rollout]:
    """Return the same steps as two rollouts."""
    endings = int(rollout.ended[:at].sum())
    per_step = [
        name for name in Rollout.__dataclass_fields__ if name not in ("last_observations", "final_observations")
    ]
    first = {name: getattr(rollout, name)[:at] for name in per_step}
    second = {name: getattr(rollout, name)[at:] for name in per_step}
    finals = rollout.final_observations
    return (
        replace(rollout, **first, last_observations=rollout.observations[at], final_observations=finals[:endings]),
        replace(rollout, **second, final_observations=finals[endings:]),
    )


@every_bonus
def test_one_finite_number_for_each_step(name: str, stream: list[Rollout]) -> None:
    bonus = make(name)
    for rollout in stream:
        reward = bonus.reward(rollout)
        assert reward.shape == rollout.rewards.shape
        assert reward.dtype == torch.float32
        assert torch.isfinite(reward).all()
        assert not reward.requires_grad
        bonus.update(rollout)


@every_bonus
def test_the_rollout_and_its_rewards_are_left_alone(name: str, stream: list[Rollout]) -> None:
    rollout = stream[0]
    before = {field: getattr(rollout, field).clone() for field in Rollout.__dataclass_fields__}
    bonus = make(name)
    reward = bonus.reward(rollout)
    bonus.update(rollout)
    assert all(torch.equal(getattr(rollout, field), before[field]) for field in before)
    assert reward.data_ptr() != rollout.rewards.data_ptr()


@every_bonus
def test_a_saved_bonus_gives_the_same_next_reward(name: str, stream: list[Rollout]) -> None:
    first = used(name, stream[0], seed=0)
    second = make(name, seed=1)
    second.load_state_dict(first.state_dict())
    for rollout in stream[1:]:
        assert torch.equal(first.reward(rollout), second.reward(rollout))
        assert dict(first.update(rollout)) == dict(second.update(rollout))


@every_bonus
def test_a_saved_state_does_not_move_with_its_bonus(name: str, stream: list[Rollout]) -> None:
    bonus = used(name, stream[0])
    state = bonus.state_dict()
    expected = bonus.reward(stream[1])
    bonus.update(stream[1])
    other = make(name)
    other.load_state_dict(state)
    assert torch.equal(other.reward(stream[1]), expected)


def seam_shows(maker: Callable[[], Bonus], rollout: Rollout, at: int) -> bool:
    """Whether the rewards of a stream depend on where it is cut into rollouts."""
    whole, pieces = maker(), maker()
    in_parts = torch.cat([pieces.reward(part) for part in cut(rollout, at)])
    return not torch.allclose(whole.reward(rollout), in_parts, rtol=1e-4, atol=1e-7)


@every_bonus
@pytest.mark.parametrize("at", [1, 70, 149])
def test_one_stream_gives_the_same_rewards_however_it_is_cut(name: str, at: int, stream: list[Rollout]) -> None:
    assert not seam_shows(lambda: used(name, stream[0]), stream[1], at)


def test_a_bonus_that_forgets_at_the_seam_is_found_out(stream: list[Rollout]) -> None:
    single = gymnasium.make("SPRL/FourRooms-7x7-v1")
    setting = Setting(single.observation_space, single.action_space, NUM_ENVS, 0, CPU)
    assert seam_shows(lambda: Forgetful(setting, NoBonusConfig()), stream[1], 70)


def ending(rollout: Rollout) -> Rollout:
    """Return the same steps, with an episode ending in the last of each sub-env."""
    truncated = rollout.truncated.clone()
    truncated[-1] = ~rollout.terminated[-1]
    finals = rollout.next_observations[rollout.terminated | truncated]
    return replace(rollout, truncated=truncated, final_observations=finals)


def past_shows(maker: Callable[[], Bonus], pasts: list[Rollout], then: Rollout) -> bool:
    """Whether rewards depend on which episodes ended before."""
    bonuses = [maker() for _ in pasts]
    for bonus, past in zip(bonuses, pasts, strict=True):
        bonus.reward(ending(past))
    first, second = (bonus.reward(then) for bonus in bonuses)
    return not torch.allclose(first, second, rtol=1e-4, atol=1e-7)


@every_bonus
def test_a_reset_clears_what_belongs_to_the_episode(name: str, stream: list[Rollout]) -> None:
    """Two that have learned the same live through different episodes; after these they pay the same."""
    assert not past_shows(lambda: used(name, stream[0]), stream[:2], stream[2])


def test_a_bonus_that_remembers_earlier_episodes_is_found_out(stream: list[Rollout]) -> None:
    single = gymnasium.make("SPRL/FourRooms-7x7-v1")
    setting = Setting(single.observation_space, single.action_space, NUM_ENVS, 0, CPU)
    assert past_shows(lambda: Unforgetting(setting, NoBonusConfig()), stream[:2], stream[2])


@every_bonus
def test_same_seed_same_rewards(name: str, stream: list[Rollout]) -> None:
    before = torch.get_rng_state()
    rewards = [used(name, stream[0], seed=3).reward(stream[1]) for _ in range(2)]
    assert torch.equal(*rewards)
    assert torch.equal(torch.get_rng_state(), before)


@every_bonus
def test_metrics_are_finite_and_privilege_is_declared(name: str, stream: list[Rollout]) -> None:
    bonus = make(name)
    bonus.reward(stream[0])
    assert all(np.isfinite(value) for value in bonus.update(stream[0]).values())
    assert isinstance(bonus.privileged, bool)


def test_privilege_is_the_same_for_an_agent_and_its_bonus() -> None:
    for value in vars(agents).values():
        if isinstance(value, agents.LearningAgentFactory):
            assert value.privileged == make(value.name).privileged


@pytest.mark.parametrize("name", sorted(set(MAKERS) - {"ppo"}))
def test_after_one_rollout_there_is_something_to_break(name: str, stream: list[Rollout]) -> None:
    assert used(name, stream[0]).reward(stream[1]).unique().numel() > 1


def test_no_bonus_is_nothing(stream: list[Rollout]) -> None:
    assert not make("ppo").reward(stream[0]).any()
