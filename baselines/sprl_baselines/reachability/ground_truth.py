"""Ground-truth reachability on grid worlds (appendix B.2): exact search on the full state.

It shows the effect of the constraint without the errors of a learned network. A state reaches itself in 0 steps, so a
step that changes nothing counts as a violation.
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
        observation_space: Space of one sub-env: square grids.
        k: Steps.

    Raises:
        ValueError: The observations are not square grids.
    """

    privileged: ClassVar[bool] = True
    ready = True

    def __init__(self, observation_space: Space[Any], k: int) -> None:
        square_grid_side(observation_space)
        self._k = k

    def judge_of(self, states: Tensor) -> Judge:
        """Return a judge of pairs of D states `[D, S, S, 3]`; its answers are 0 or 1."""
        grids = states.cpu().numpy()

        def judge(earlier: Tensor, later: Tensor) -> Tensor:
            reached = solver.reachable(grids[earlier.cpu().numpy()], grids[later.cpu().numpy()], self._k)
            return torch.from_numpy(reached).to(states.device, torch.float32)

        return judge

    def update(self, rollout: Rollout) -> Mapping[str, float]:  # noqa: ARG002 - there is nothing to train
        """Train nothing."""
        return {}

    def weights(self) -> Mapping[str, Any]:
        """Return nothing: there are no parameters."""
        return {}

    def load_weights(self, weights: Mapping[str, Any]) -> None:
        """Take nothing."""

    def state_dict(self) -> Mapping[str, Any]:
        """Return an empty state."""
        return {}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Restore nothing."""
