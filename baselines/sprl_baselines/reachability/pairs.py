"""Judging many pairs of states: each distinct state is looked at once, and each distinct pair judged once."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, ClassVar, Protocol

from torch import Tensor

from sprl_baselines.learning.rollout import Rollout, Rows, compute_once

Judge = Callable[[Tensor, Tensor], Tensor]
"""Takes indices `[P]` of earlier and of later states; returns how likely one leads to the other, `[P]` in [0, 1]."""


class Reachability(Protocol):
    """Says whether one state leads to another within k steps. The order matters: some steps cannot be undone."""

    privileged: ClassVar[bool]  # whether it sees what an ordinary agent does not

    @property
    def ready(self) -> bool:
        """Whether it may be trusted yet; once true, always true."""

    def judge_of(self, states: Tensor) -> Judge:
        """Look at D states `[D, ...]` once, and return what judges pairs of them."""

    def update(self, rollout: Rollout) -> Mapping[str, float]:
        """Learn from a rollout, if there is anything to learn, and return metrics."""

    def state_dict(self) -> Mapping[str, Any]:
        """Return all that later judgements depend on."""

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Take such a state."""


def judge_pairs(reachability: Reachability, states: Rows) -> Judge:
    """Return a judge of pairs among B states that may repeat."""
    judge, count, places = reachability.judge_of(states.distinct), len(states.distinct), states.places

    def judge_repeated(earlier: Tensor, later: Tensor) -> Tensor:
        pairs = places[earlier] * count + places[later]
        return compute_once(lambda needed: judge(needed // count, needed % count), pairs)

    return judge_repeated
