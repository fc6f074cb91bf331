"""Reward normalisation: the running variance against NumPy, the discounted sums by hand, and both over any cut."""

from __future__ import annotations

import json

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from sprl_baselines.learning.moments import RewardNormalizer, RunningVariance

CPU = torch.device("cpu")
batches = st.lists(st.lists(st.floats(-1e3, 1e3), min_size=1, max_size=9), min_size=1, max_size=6)


@given(batches)
def test_the_running_variance_is_that_of_all_values(batches: list[list[float]]) -> None:
    running = RunningVariance()
    for batch in batches:
        running.update(torch.tensor(batch))
    everything = np.concatenate([np.float32(batch).astype(np.float64) for batch in batches])
    assert running.count == len(everything)
    assert running.variance == pytest.approx(everything.var(), rel=1e-9, abs=1e-9)


def test_nothing_has_no_variance() -> None:
    assert RunningVariance().variance == 0.0


def test_rewards_against_a_hand_computed_answer() -> None:
    """Two sub-envs at discount 0.5; the first one's episode ends after its second step."""
    normalizer = RewardNormalizer(2, 0.5, CPU)
    rewards = torch.tensor([[1.0, 0.0], [2.0, 4.0], [0.0, 0.0]])
    ended = torch.tensor([[False, False], [True, False], [False, False]])
    sums = [1.0, 0.0, 2.5, 4.0, 0.0, 2.0]  # step by step
    scaled = normalizer(rewards, ended)
    assert normalizer.deviation == pytest.approx(np.std(sums))
    assert torch.allclose(scaled, rewards / np.std(sums).astype(np.float32))
    assert scaled.dtype == torch.float32


def test_a_sum_goes_on_in_the_next_rollout_and_the_moments_remember() -> None:
    normalizer = RewardNormalizer(1, 0.5, CPU)
    alive = torch.tensor([[False]])
    normalizer(torch.tensor([[4.0]]), alive)
    normalizer(torch.tensor([[0.0]]), alive)
    assert normalizer.deviation == pytest.approx(np.std([4.0, 2.0]))


def test_without_a_difference_rewards_stay_as_they_are() -> None:
    normalizer = RewardNormalizer(1, 0.99, CPU)
    assert normalizer(torch.zeros(3, 1), torch.zeros(3, 1, dtype=torch.bool)).tolist() == [[0.0]] * 3
    assert normalizer.deviation == 1.0


def test_the_rewards_given_are_not_written_to() -> None:
    rewards = torch.tensor([[1.0], [0.0]])
    RewardNormalizer(1, 0.9, CPU)(rewards, torch.zeros(2, 1, dtype=torch.bool))
    assert rewards.tolist() == [[1.0], [0.0]]


@given(cut=st.integers(1, 11), seed=st.integers(0, 2**31))
def test_a_stream_cut_in_two_comes_to_the_same_deviation(cut: int, seed: int) -> None:
    generator = torch.Generator().manual_seed(seed)
    rewards = torch.randn(12, 3, generator=generator)
    ended = torch.rand(12, 3, generator=generator) < 0.2
    whole, parts = RewardNormalizer(3, 0.9, CPU), RewardNormalizer(3, 0.9, CPU)
    whole(rewards, ended)
    parts(rewards[:cut], ended[:cut])
    parts(rewards[cut:], ended[cut:])
    assert parts.deviation == pytest.approx(whole.deviation, rel=1e-9)


def test_a_saved_normalizer_goes_on_exactly() -> None:
    generator = torch.Generator().manual_seed(0)
    first, second = RewardNormalizer(3, 0.9, CPU), RewardNormalizer(3, 0.9, CPU)
    alive = torch.zeros(5, 3, dtype=torch.bool)
    first(torch.randn(5, 3, generator=generator), alive)
    state = first.state_dict()
    state["moments"] = json.loads(json.dumps(state["moments"]))
    second.load_state_dict(state)
    rewards = torch.randn(5, 3, generator=generator)
    assert torch.equal(first(rewards, alive), second(rewards, alive))
