"""Advantages against hand-computed numbers and the definition as a plain double sum."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor

from sprl_baselines.learning.returns import generalized_advantages, successor_values

REWARDS, VALUES, NEXT_VALUES = [1.0, 0.0, 2.0], [1.0, 2.0, 3.0], [2.0, 3.0, 4.0]
NEVER, AT_STEP_1 = [False, False, False], [False, True, False]


def column(numbers: list[Any]) -> Tensor:
    return torch.tensor(numbers).unsqueeze(1)


def advantages(terminated: list[bool], truncated: list[bool], **changes: Any) -> list[float]:
    arguments: dict[str, Any] = {"gamma": 0.5, "gae_lambda": 0.5, **changes}
    ends = column(terminated), column(truncated)
    found = generalized_advantages(column(REWARDS), column(VALUES), column(NEXT_VALUES), *ends, **arguments)
    return found.squeeze(1).tolist()


# The one-step errors are 1 + 1 - 1 = 1, 0 + 1.5 - 2 = -0.5 and 2 + 2 - 3 = 1; each later one counts a quarter.


def test_without_endings() -> None:
    assert advantages(NEVER, NEVER) == [0.9375, -0.25, 1.0]


def test_nothing_follows_a_termination() -> None:
    for bootstrap in (False, True):
        assert advantages(AT_STEP_1, NEVER, bootstrap_on_truncation=bootstrap) == [0.5, -2.0, 1.0]


def test_a_truncation_counts_as_an_ending_unless_bootstrapped() -> None:
    assert advantages(NEVER, AT_STEP_1) == [0.5, -2.0, 1.0]
    assert advantages(NEVER, AT_STEP_1, bootstrap_on_truncation=True) == [0.875, -0.5, 1.0]


def test_where_both_fall_on_one_step_the_task_has_ended() -> None:
    assert advantages(AT_STEP_1, AT_STEP_1, bootstrap_on_truncation=True) == [0.5, -2.0, 1.0]


def test_lambda_zero_leaves_the_one_step_errors() -> None:
    assert advantages(NEVER, NEVER, gae_lambda=0.0) == [1.0, -0.5, 1.0]


def test_lambda_one_gives_the_whole_return_less_the_value() -> None:
    assert advantages(NEVER, [False, False, True], gamma=1.0, gae_lambda=1.0)[0] == sum(REWARDS) - VALUES[0] + (2 - 2)


def by_definition(
    rewards: Tensor, values: Tensor, following: Tensor, terminated: Tensor, truncated: Tensor, bootstrap: bool
) -> Tensor:
    """Sum (gamma * lambda)^l times the error l steps later, up to and including the first ending."""
    gamma, gae_lambda = 0.9, 0.8
    result = torch.zeros_like(rewards)
    steps, envs = rewards.shape
    for n in range(envs):
        for t in range(steps):
            for later in range(t, steps):
                dead = terminated[later, n] or (truncated[later, n] and not bootstrap)
                error = rewards[later, n] - values[later, n] + (0.0 if dead else gamma * following[later, n])
                result[t, n] += (gamma * gae_lambda) ** (later - t) * error
                if terminated[later, n] or truncated[later, n]:
                    break
    return result


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 2**31), steps=st.integers(1, 7), envs=st.integers(1, 3), bootstrap=st.booleans())
def test_agrees_with_the_definition_and_writes_to_nothing(seed: int, steps: int, envs: int, bootstrap: bool) -> None:
    generator = np.random.default_rng(seed)
    numbers = [torch.from_numpy(generator.normal(size=(steps, envs))) for _ in range(3)]
    ends = [torch.from_numpy(generator.random((steps, envs)) < 0.3) for _ in range(2)]
    before = [tensor.clone() for tensor in (*numbers, *ends)]
    found = generalized_advantages(*numbers, *ends, gamma=0.9, gae_lambda=0.8, bootstrap_on_truncation=bootstrap)
    torch.testing.assert_close(found, by_definition(*numbers, *ends, bootstrap))
    for now, then in zip((*numbers, *ends), before, strict=True):
        assert torch.equal(now, then)


def test_successors_of_endings_are_the_true_ones() -> None:
    values = torch.tensor([[1.0, 10.0], [2.0, 20.0], [3.0, 30.0]])
    ended = torch.tensor([[False, True], [False, False], [True, True]])
    found = successor_values(values, torch.tensor([4.0, 40.0]), ended, torch.tensor([-1.0, -2.0, -3.0]))
    assert found.tolist() == [[2.0, -1.0], [3.0, 30.0], [-2.0, -3.0]]


@pytest.mark.parametrize("bootstrap", [False, True])
def test_a_rollout_in_two_parts_agrees_beyond_an_ending(bootstrap: bool) -> None:
    """What follows an ending cannot reach back over it."""
    ends = {"terminated": NEVER, "truncated": AT_STEP_1}
    whole = advantages(**ends, bootstrap_on_truncation=bootstrap)
    first = generalized_advantages(
        column(REWARDS[:2]),
        column(VALUES[:2]),
        column(NEXT_VALUES[:2]),
        column(ends["terminated"][:2]),
        column(ends["truncated"][:2]),
        gamma=0.5,
        gae_lambda=0.5,
        bootstrap_on_truncation=bootstrap,
    )
    assert first.squeeze(1).tolist() == whole[:2]
