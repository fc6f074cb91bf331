"""Training triplets: an anchor, a state soon after it (positive) and a state long after it (negative) (Algorithm 1).

Every anchor needs a negative. Otherwise short episodes would give only positives, and the network could learn to always
answer "reachable".
"""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor

from sprl_baselines.reachability.replay import Segments


class Triplets(NamedTuple):
    """P triplets of places in a replay, each `[P]` int64."""

    anchors: Tensor
    positives: Tensor
    negatives: Tensor

    def take(self, indices: Tensor) -> Triplets:
        """Return the triplets at these indices."""
        return Triplets(*(places[indices] for places in self))


class Ranges(NamedTuple):
    """The distances of positives and negatives from their anchor, in steps, both ends included."""

    positive: tuple[int, int]
    negative: tuple[int, int]


NEGATIVES = ("episode", "double")
UNLIMITED = 2**40


def training_ranges(k: int, tolerance: int, negative_bias: int, negatives: str) -> Ranges:
    """Return the ranges of training triplets.

    Args:
        k: Steps within which a state counts as reached.
        tolerance: Further steps that are tolerated.
        negative_bias: Further steps between positives and negatives.
        negatives: "episode" draws from k + `negative_bias` to the end of the episode (Algorithm 1); "double" draws from
            the range on which accuracy is measured (appendix B.1).
    """
    if negatives == "double":
        return Ranges((1, k), accuracy_ranges(k, tolerance, negative_bias).negative)
    return Ranges((1, k), (k + negative_bias, UNLIMITED))


def accuracy_ranges(k: int, tolerance: int, negative_bias: int) -> Ranges:
    """Return the ranges on which accuracy is measured (appendix B.1)."""
    reach = k + tolerance
    return Ranges((1, reach), (reach + negative_bias, reach + 2 * negative_bias))


def walk(segments: Segments, ranges: Ranges, positive_bias: int, generator: torch.Generator) -> Triplets:
    """Draw triplets along all stretches at once (Algorithm 1).

    Args:
        segments: The stretches.
        ranges: The distances of positives and negatives.
        positive_bias: The next anchor lies 1 to this many steps after the positive.
        generator: Random generator, on the CPU.
    """
    starts, lengths = segments
    anchors, drawn = torch.zeros_like(lengths), []
    while True:
        roomy = anchors + ranges.negative[0] < lengths
        starts, lengths, anchors = starts[roomy], lengths[roomy], anchors[roomy]
        drawn.append(_around(starts, lengths, anchors, ranges, generator))
        if not len(anchors):
            return Triplets(*(torch.cat(places) for places in zip(*drawn, strict=True)))
        positives = drawn[-1].positives - starts
        anchors = _uniform(positives + 1, positives + positive_bias, generator)


def scatter(segments: Segments, ranges: Ranges, count: int, generator: torch.Generator) -> Triplets:
    """Draw `count` triplets with anchors uniform over all states that have a negative; none if there are none."""
    room = (segments.lengths - ranges.negative[0]).clamp(min=0)  # [S] anchors in each
    before = room.cumsum(0) - room
    total = int(room.sum())
    first = torch.zeros(count if total else 0, dtype=torch.int64)
    ranks = _uniform(first, first + total - 1, generator)
    rows = torch.searchsorted(room.cumsum(0), ranks, right=True)
    anchors = ranks - before[rows]
    return _around(segments.starts[rows], segments.lengths[rows], anchors, ranges, generator)


def _around(starts: Tensor, lengths: Tensor, anchors: Tensor, ranges: Ranges, generator: torch.Generator) -> Triplets:
    """Draw a positive and a negative for each anchor."""
    nearest, furthest = ranges.positive
    positives = _uniform(anchors + nearest, anchors + furthest, generator)
    least, most = ranges.negative
    negatives = _uniform(anchors + least, (anchors + most).clamp(max=lengths - 1), generator)
    return Triplets(starts + anchors, starts + positives, starts + negatives)


def _uniform(low: Tensor, high: Tensor, generator: torch.Generator) -> Tensor:
    """Draw integers between bounds `[B]`, both included, as int64."""
    shares = torch.rand(len(low), generator=generator, dtype=torch.float64)
    return low.long() + (shares * (high - low + 1)).long()
