"""Minibatches: every sample once in an epoch, and means over the gradient steps."""

from __future__ import annotations

from dataclasses import dataclass

import pytest
import torch
from torch import Tensor

from sprl_baselines.learning.minibatches import Batch, shuffled_minibatches, train
from sprl_baselines.learning.rollout import Rows


@dataclass(frozen=True)
class Numbered(Batch):
    """Numbers, and rows that say the same."""

    rows: Rows
    numbers: Tensor


def numbered(count: int) -> Numbered:
    numbers = torch.arange(count)
    return Numbered(Rows.of(numbers.view(-1, 1)), numbers)


def test_every_epoch_sees_every_sample_once_in_near_equal_parts() -> None:
    samples = numbered(64)
    parts = list(shuffled_minibatches(samples, 2, 7, torch.Generator().manual_seed(0)))
    assert [len(part) for part in parts] == [10, 9, 9, 9, 9, 9, 9] * 2
    assert all(torch.equal(part.rows.expanded().squeeze(1), part.numbers) for part in parts)
    epochs = [torch.cat([part.numbers for part in half]) for half in (parts[:7], parts[7:])]
    assert all(torch.equal(epoch.sort().values, samples.numbers) for epoch in epochs)
    assert not torch.equal(*epochs)


def test_reports_are_averaged_over_the_steps() -> None:
    batches = iter([numbered(2), numbered(4)])
    means = train(lambda batch: {"size": torch.tensor(float(len(batch))), "one": torch.ones(())}, batches)
    assert means == pytest.approx({"size": 3.0, "one": 1.0})
