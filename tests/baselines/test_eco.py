"""ECO: what is remembered and what it is worth, by hand and against a slow and plain implementation."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch
from gymnasium import spaces
from hypothesis import given
from hypothesis import strategies as st
from torch import Tensor

from sprl_baselines.bonus import Setting
from sprl_baselines.eco import ECO, ECOConfig
from sprl_baselines.learning.rollout import Rollout

CPU = torch.device("cpu")
LINE = spaces.Box(-1e6, 1e6, (1,), np.float32)


class Near:
    """Certain within 1, impossible from 3 on, linear between."""

    ready = True

    def judge_of(self, states: Tensor) -> Any:
        return lambda earlier, later: near(states[earlier] - states[later]).squeeze(-1)


def near(difference: Tensor) -> Tensor:
    return (1.5 - difference.abs() / 2).clamp(0, 1)


def rollout_of(states: Tensor, ended: Tensor) -> Rollout:
    """`states` `[T + 1, N]`; the true successors of ending steps are far away, where nothing has been."""
    steps, num_envs = ended.shape
    return Rollout(
        observations=states[:-1, :, None],
        actions=torch.zeros(steps, num_envs),
        rewards=torch.zeros(steps, num_envs),
        terminated=ended,
        truncated=torch.zeros_like(ended),
        values=torch.zeros(steps, num_envs),
        log_probs=torch.zeros(steps, num_envs),
        last_observations=states[-1, :, None],
        final_observations=torch.full((int(ended.sum()), 1), 1e5),
        positions=torch.zeros(steps, num_envs, 0),
        next_positions=torch.zeros(steps, num_envs, 0),
    )


def eco(num_envs: int = 1, **settings: Any) -> ECO:
    config = ECOConfig(**{"bonus_weight": 1.0, "bias": 0.5, **settings})
    made = ECO(Setting(LINE, spaces.Discrete(2), num_envs, seed=0, device=CPU), config)
    made.reachability = Near()  # type: ignore[assignment]
    return made


def walk(made: ECO, states: list[float], ends: tuple[int, ...] = ()) -> list[float]:
    ended = torch.zeros(len(states) - 1, 1, dtype=torch.bool)
    ended[list(ends)] = True
    return made.reward(rollout_of(torch.tensor(states).unsqueeze(1), ended)).squeeze(1).tolist()


def test_what_is_familiar_is_cheap_and_what_is_novel_is_remembered() -> None:
    """From 0: 1 is certain; 2.5 is .25 likely, so it is remembered; then 3 is near to that."""
    made = eco(familiarity_quantile=1.0)
    assert walk(made, [0, 1, 2.5, 3, 0]) == [-0.5, 0.25, -0.5, -0.5]
    assert made._counts.tolist() == [2]


def test_the_quantile_lies_between_ranks() -> None:
    """Four remembered states, 0, 10, 20 and 30; 11 is near to one of them only."""
    made = eco()
    assert walk(made, [0, 10, 20, 30, 11])[-1] == pytest.approx(0.5 - np.percentile([0, 1, 0, 0], 90))
    assert made._counts.tolist() == [4]  # .7 is familiar enough


def test_an_ending_pays_nothing_and_the_next_episode_remembers_its_own_start_alone() -> None:
    made = eco()
    rewards = walk(made, [0, 10, 50, 51, 0], ends=(1,))
    assert rewards == [0.5, 0.0, -0.5, 0.5]  # 10 is new; the ending; 51 is near 50; 0 is new again
    assert made._memory[: int(made._counts[0])].flatten().tolist() == [50, 0]


def test_memory_goes_on_in_the_next_rollout() -> None:
    made = eco(familiarity_quantile=1.0)
    walk(made, [0, 10])
    assert walk(made, [10, 20, 0]) == [0.5, -0.5]


def test_a_full_memory_replaces_one_at_random() -> None:
    made = eco(memory_size=3)
    walk(made, [10.0 * step for step in range(60)])
    assert made._counts.tolist() == [3]
    kept = sorted(made._memory.flatten().tolist())
    assert kept[0] > 20.0  # no place is kept for ever: by chance, with a probability of (2/3)^57 each
    assert kept != [570.0, 580.0, 590.0]  # nor does the oldest go: seed 0 decides


class Onward:
    """Every state leads to those that are not less."""

    ready = True

    def judge_of(self, states: Tensor) -> Any:
        return lambda earlier, later: (states[later] >= states[earlier]).float().squeeze(-1)


def test_it_asks_whether_the_remembered_state_leads_to_the_new_one() -> None:
    made = eco()
    made.reachability = Onward()  # type: ignore[assignment]
    assert walk(made, [0, 5, -3]) == [-0.5, 0.5]


def test_nothing_is_paid_or_remembered_before_the_network_is_ready() -> None:
    made = ECO(Setting(LINE, spaces.Discrete(2), 1, seed=0, device=CPU), ECOConfig())
    assert walk(made, [0, 10, 20]) == [0.0, 0.0]
    assert made._counts.tolist() == [0]


def plain(states: np.ndarray, ended: np.ndarray, config: ECOConfig) -> np.ndarray:
    """One sub-env, step by step."""
    memory: list[float] = [states[0]]
    rewards = []
    for step, over in enumerate(ended):
        if over:
            memory = [states[step + 1]]
            rewards.append(0.0)
            continue
        answers = [float(near(torch.tensor(one - states[step + 1]))) for one in memory]
        familiarity = np.percentile(answers, 100 * config.familiarity_quantile)
        if familiarity < config.novelty_threshold:
            memory.append(states[step + 1])
        rewards.append(config.bonus_weight * (config.bias - familiarity))
    return np.array(rewards)


@given(
    steps=st.integers(2, 40),
    num_envs=st.integers(1, 4),
    cut=st.integers(1, 39),
    quantile=st.sampled_from([0.5, 0.9, 1.0]),
    seed=st.integers(0, 999),
)
def test_the_bonus_is_that_of_the_definition(steps: int, num_envs: int, cut: int, quantile: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    states = rng.integers(0, 30, size=(steps + 1, num_envs)).astype(np.float32) / 2
    ended = rng.random((steps, num_envs)) < 0.1
    made = eco(num_envs, familiarity_quantile=quantile, bias=0.7, bonus_weight=0.1)
    cut = min(cut, steps - 1)
    parts = [slice(0, cut), slice(cut, steps)]
    rewards = [
        made.reward(rollout_of(torch.from_numpy(states[part.start : part.stop + 1]), torch.from_numpy(ended[part])))
        for part in parts
    ]
    expected = [plain(states[:, env], ended[:, env], made.config) for env in range(num_envs)]
    assert np.allclose(torch.cat(rewards).numpy(), np.stack(expected, axis=1), atol=1e-6)
