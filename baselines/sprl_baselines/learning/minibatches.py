"""Training on a batch of samples: epochs of shuffled minibatches, and the means of what the gradient steps report."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields
from typing import Any, Self, TypeVar

import torch
from torch import Tensor

Report = dict[str, Tensor]  # scalars by name


@dataclass(frozen=True)
class Batch:
    """Base of the sample classes: every field holds B rows."""

    def __len__(self) -> int:
        return len(self._columns()[0])

    def take(self, indices: Tensor) -> Self:
        """Return the samples at these indices."""
        return type(self)(*(column[indices] for column in self._columns()))

    def _columns(self) -> list[Any]:
        return [getattr(self, field.name) for field in fields(self)]


B = TypeVar("B", bound=Batch)


def shuffled_minibatches(samples: B, epochs: int, minibatches: int, generator: torch.Generator) -> Iterator[B]:
    """Yield all samples `epochs` times, each time in a new order and in `minibatches` parts of nearly equal size."""
    for _ in range(epochs):
        order = torch.randperm(len(samples), generator=generator, device=generator.device)
        for indices in order.tensor_split(minibatches):
            yield samples.take(indices)


def train(gradient_step: Callable[[B], Report], batches: Iterator[B]) -> dict[str, float]:
    """Take a gradient step on each batch, and return the mean of each number that the steps report."""
    reports = [gradient_step(batch) for batch in batches]
    means = torch.stack([torch.stack(list(report.values())) for report in reports]).mean(dim=0).tolist()
    return dict(zip(reports[0], means, strict=True))
