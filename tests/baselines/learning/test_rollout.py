"""Distinct rows: found once, in order of appearance, and given to a network once."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor, nn

from sprl_baselines.learning import rollout as module
from sprl_baselines.learning.rollout import Rollout, Rows, compute_once

floats = st.lists(st.lists(st.sampled_from([0.0, 1.5, -2.0]), min_size=2, max_size=2), min_size=1, max_size=30)


def test_distinct_rows_in_order_of_appearance() -> None:
    rows = Rows.of(torch.tensor([[3, 1], [2, 2], [3, 1], [3, 2], [2, 2]], dtype=torch.uint8))
    assert rows.distinct.tolist() == [[3, 1], [2, 2], [3, 2]]
    assert rows.places.tolist() == [0, 1, 0, 2, 1]


@settings(max_examples=40, deadline=None)
@given(floats)
def test_distinct_rows_are_distinct_and_give_the_rows_back(rows: list[list[float]]) -> None:
    observations = torch.tensor(rows, dtype=torch.float64)
    found = Rows.of(observations)
    assert torch.equal(found.expanded(), observations)
    assert len({tuple(row) for row in found.distinct.tolist()}) == len(found.distinct)


@settings(max_examples=40, deadline=None)
@given(floats, floats)
def test_joined_rows_are_those_of_the_joined_tensors(first: list[list[float]], second: list[list[float]]) -> None:
    tensors = torch.tensor(first), torch.tensor(second)
    ours, expected = Rows.of(tensors[0]) + Rows.of(tensors[1]), Rows.of(torch.cat(tensors))
    assert torch.equal(ours.distinct, expected.distinct)
    assert torch.equal(ours.places, expected.places)


@settings(max_examples=40, deadline=None)
@given(floats, st.integers(0, 99))
def test_some_rows_in_order_are_those_of_the_same_part_of_the_tensor(rows: list[list[float]], seed: int) -> None:
    observations = torch.tensor(rows)
    indices = torch.randint(len(rows), (7,), generator=torch.Generator().manual_seed(seed))
    ours, expected = Rows.of(observations)[indices].in_order(), Rows.of(observations[indices])
    assert torch.equal(ours.distinct, expected.distinct)
    assert torch.equal(ours.places, expected.places)


@pytest.mark.parametrize("shape", [(40,), (20, 2)])
def test_a_network_on_distinct_rows_gives_what_it_gives_on_all(shape: tuple[int, ...]) -> None:
    """In outputs and gradients, and it sees each row once."""
    generator = torch.Generator().manual_seed(0)
    pool = torch.randn(5, 3, generator=generator)
    rows = Rows.of(pool[torch.randint(4, (40,), generator=generator)])
    rows = Rows(rows.distinct, rows.places.view(shape))
    layer, seen = nn.Linear(3, 2), []

    def network(inputs: Tensor) -> Tensor:
        seen.append(len(inputs))
        outputs: Tensor = layer(inputs)
        return outputs

    gradients = []
    for outputs in (rows.through(network), layer(rows.expanded())):
        layer.zero_grad()
        (outputs.square() * torch.arange(float(shape[0])).view(-1, *[1] * len(shape))).sum().backward()
        gradients.append((outputs.detach(), layer.weight.grad.clone(), layer.bias.grad.clone()))
    for ours, plain in zip(*gradients, strict=True):
        torch.testing.assert_close(ours, plain, rtol=1e-4, atol=1e-4)
    assert seen == [len(rows.distinct)]


def test_two_outputs_are_spread_alike() -> None:
    once, keys = [], torch.tensor([[7, 2], [7, 7]])

    def function(needed: Tensor) -> tuple[Tensor, Tensor]:
        once.extend(needed.tolist())
        return needed * 10, torch.stack((needed, -needed), dim=1)

    tens, pairs = compute_once(function, keys)
    assert once == [2, 7]
    assert torch.equal(tens, keys * 10)
    assert torch.equal(pairs, torch.stack((keys, -keys), dim=-1))


def drawn_rollout() -> Rollout:
    """Five different observations in 30 steps of 3 sub-envs, with a few endings."""
    generator = torch.Generator().manual_seed(3)
    pool = torch.randint(9, (5, 2, 2), generator=generator, dtype=torch.uint8)
    zeros, ended = torch.zeros(30, 3), torch.rand(30, 3, generator=generator) < 0.2

    def observed(*shape: int) -> Tensor:
        return pool[torch.randint(5, shape, generator=generator)]

    return Rollout(
        observations=observed(30, 3),
        actions=zeros,
        rewards=zeros,
        terminated=ended,
        truncated=torch.zeros_like(ended),
        values=zeros,
        log_probs=zeros,
        last_observations=observed(3),
        final_observations=observed(int(ended.sum())),
        positions=zeros[..., None][..., :0],
        next_positions=zeros[..., None][..., :0],
    )


def test_what_was_observed_visited_and_followed() -> None:
    rollout = drawn_rollout()
    observations, last = rollout.observations, rollout.last_observations[None]
    following = torch.cat((observations[1:], last))
    visited = torch.cat((observations, last)).flatten(0, 1)
    following[rollout.ended] = rollout.final_observations
    assert torch.equal(rollout.observed.expanded(), observations.flatten(0, 1))
    assert torch.equal(rollout.visited.distinct, Rows.of(visited).distinct)
    assert torch.equal(rollout.visited.expanded(), visited)
    pairs = torch.stack((observations, following), dim=2).flatten(0, 1)
    assert torch.equal(rollout.transitions.distinct, Rows.of(pairs.flatten(0, 1)).distinct)
    assert torch.equal(rollout.transitions.expanded(), pairs)
    assert torch.equal(rollout.next_observations, following)


def test_a_rollout_is_hashed_once(monkeypatch: pytest.MonkeyPatch) -> None:
    hashed, rollout, of = [], drawn_rollout(), Rows.of
    monkeypatch.setattr(module.Rows, "of", lambda rows: hashed.append(len(rows)) or of(rows))
    for _ in range(2):
        _ = rollout.observed, rollout.visited, rollout.transitions
    assert hashed == [30 * 3 + 3 + len(rollout.final_observations)]
    _ = replace(rollout).observed
    assert len(hashed) == 2
