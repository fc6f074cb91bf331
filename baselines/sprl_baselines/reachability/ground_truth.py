"""The ground-truth reachability network on grid worlds (appendix B.2): exact search on the full state.

Nothing is learned, so it removes the network's errors from the question of what the constraint itself does. A state
reaches itself: standing still is no progress.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

import torch
from gymnasium import Space
from torch import Tensor

from sprl_baselines.learning.grids import square_grid_side
from sprl_baselines.learning.rollout import Rollout
from sprl_baselines.reachability.pairs import Judge
from sprl_bench import solver


class GroundTruth:
    """Whether some sequence of at most k actions leads from one state to another.

    Args:
        observation_space: Of one sub-env; it must be a grid world's.
        k: Steps.

    Raises:
        ValueError: The observations are no grids, so there is no full state to search.
    """

    privileged: ClassVar[bool] = True
    ready = True

    def __init__(self, observation_space: Space[Any], k: int) -> None:
        square_grid_side(observation_space)
        self._k = k

    def judge_of(self, states: Tensor) -> Judge:
        """Return what searches from one of D states `[D, S, S, 3]` to another, as 0 or 1."""
        grids = states.cpu().numpy()

        def judge(earlier: Tensor, later: Tensor) -> Tensor:
            reached = solver.reachable(grids[earlier.cpu().numpy()], grids[later.cpu().numpy()], self._k)
            return torch.from_numpy(reached).to(states.device, torch.float32)

        return judge

    def update(self, rollout: Rollout) -> Mapping[str, float]:  # noqa: ARG002 - the truth does not change
        """Learn nothing."""
        return {}

    def state_dict(self) -> Mapping[str, Any]:
        """Return nothing, as nothing is learned."""
        return {}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Take nothing."""
