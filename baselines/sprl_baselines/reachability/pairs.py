"""The interface of reachability, and judging many pairs: each distinct state and pair is computed once."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, ClassVar, Protocol

from torch import Tensor

from sprl_baselines.learning.rollout import Rollout, Rows, compute_once

Judge = Callable[[Tensor, Tensor], Tensor]
"""Takes indices `[P]` of earlier and of later states; returns the probabilities of reachability, `[P]`."""


class Reachability(Protocol):
    """Judges whether one state leads to another within k steps. The order matters: some steps cannot be undone."""

    privileged: ClassVar[bool]  # whether it uses more than observations and rewards

    @property
    def ready(self) -> bool:
        """Whether its answers are accurate enough to use; once true, always true."""

    def judge_of(self, states: Tensor) -> Judge:
        """Embed D states `[D, ...]` once, and return a judge of pairs of them."""

    def update(self, rollout: Rollout) -> Mapping[str, float]:
        """Train on a rollout, if there is anything to train, and return metrics."""

    def weights(self) -> Mapping[str, Any]:
        """Return the parameters that judging needs, if there are any."""

    def load_weights(self, weights: Mapping[str, Any]) -> None:
        """Take such parameters."""

    def state_dict(self) -> Mapping[str, Any]:
        """Return everything that later answers depend on."""

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Restore such a state."""


def judge_pairs(reachability: Reachability, states: Rows) -> Judge:
    """Return a judge of pairs among B states that may repeat."""
    judge, count, places = reachability.judge_of(states.distinct), len(states.distinct), states.places

    def judge_repeated(earlier: Tensor, later: Tensor) -> Tensor:
        pairs = places[earlier] * count + places[later]
        return compute_once(lambda needed: judge(needed // count, needed % count), pairs)

    return judge_repeated
