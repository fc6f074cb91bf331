"""SPRL: a cost on steps that violate the k-shortest-path constraint (Sohn et al. 2021).

A step violates the constraint if its successor can be reached within k steps from a state that the agent left more
than k steps ago: the path between them was not a shortest one. With cost c = 1 for a violation and 0 otherwise, the
bonus is cost_scale * (bias - c). Two states are compared only if there is no reward and no end of an episode between
them. Paths of the lengths k + tolerance, k + 2 tolerance, ... vote, so that a single wrong answer of the network has no
effect (appendix A.2, E.3).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any

import torch
from torch import Tensor

from sprl_baselines.bonus import Setting
from sprl_baselines.learning.config import Choice, Count, Share, Weight
from sprl_baselines.learning.rollout import Rollout, Rows
from sprl_baselines.reachability import (
    GroundTruth,
    HorizonConfig,
    Judge,
    LearnedReachability,
    Reachability,
    ReachabilityConfig,
    judge_pairs,
)

CHUNK = 8  # path lengths judged in one batch; judging stops early between batches


@dataclass(frozen=True)
class ConstraintConfig(HorizonConfig):
    """Hyperparameters of the cost; the defaults are for the grids."""

    tolerance_samples: Count = 60  # path lengths that vote: k + tolerance, k + 2 tolerance, ... (Table 1)
    vote_threshold: Share = 0.5  # an answer above this is a vote for a violation
    vote_quantile: Share = 0.9  # the cost is this quantile of the votes (appendix E.3)
    cost_scale: Weight = 0.002  # weight of the whole bonus (Table 1)
    bias: float = 0.5  # added to every step's bonus, before scaling
    # What cost_scale is per: an env step, or the duration of a reference action (Fetch, substep 20).
    cost_per: Annotated[str, Choice("action", "reference-action")] = "action"

    def scale(self, action_time: float) -> float:
        """Return the cost scale per env step, which lasts so many reference actions."""
        return self.cost_scale if self.cost_per == "action" else self.cost_scale * action_time


@dataclass(frozen=True)
class SPRLConfig(ConstraintConfig, ReachabilityConfig):
    """Hyperparameters of the cost and of the network that finds violations."""


class SPRL:
    """The cost of the violations that `reachability` finds. The bonus is 0 until `reachability` is ready.

    Args:
        setting: The environment and device.
        config: Hyperparameters of the cost.
        reachability: Judges whether one state leads to another within k steps.
    """

    def __init__(self, setting: Setting, config: ConstraintConfig, reachability: Reachability) -> None:
        self.config, self.reachability = config, reachability
        self.privileged = reachability.privileged
        lengths = config.k + config.tolerance * torch.arange(1, config.tolerance_samples + 1)
        self._lengths = lengths.to(setting.device)  # [J]
        self._needed = votes_needed(config.tolerance_samples, config.vote_quantile)
        self._scale = config.scale(setting.action_time)
        self._recent = torch.empty(0)  # [M, N, ...] the last states; M is the longest path length
        self._runs = torch.zeros(setting.num_envs, dtype=torch.int64, device=setting.device)  # [N] steps since a cut
        self._violations = 0.0  # share of the last rollout's steps

    @classmethod
    def learned(cls, setting: Setting, config: SPRLConfig) -> SPRL:
        """Find violations with a learned network."""
        return cls(setting, config, LearnedReachability(setting, config))

    @classmethod
    def true(cls, setting: Setting, config: ConstraintConfig) -> SPRL:
        """Find violations by exact search on the grid's full state, from the first step on (appendix B.2)."""
        return cls(setting, config, GroundTruth(setting.observation_space, config.k))

    def reward(self, rollout: Rollout) -> Tensor:
        """Return cost_scale * (bias - cost) for each step, `[T, N]`."""
        recent = self._recent if len(self._recent) else self._blank(rollout)
        states = Rows.of(recent.flatten(0, 1)) + rollout.visited
        runs = _runs(self._runs, rollout.cuts)
        self._recent = states[rollout.num_steps : -len(rollout.last_observations)].expanded().view_as(recent)
        self._runs = runs[-1]
        if not self.reachability.ready:
            return torch.zeros_like(rollout.rewards)
        costs = self._costs(states, runs)
        self._violations = float(costs.mean())
        return self._scale * (self.config.bias - costs)

    def _blank(self, rollout: Rollout) -> Tensor:
        """Return all-zero states to precede the first rollout, `[M, N, ...]`."""
        first = rollout.observations[:1]
        return torch.zeros_like(first).expand(int(self._lengths[-1]), *first.shape[1:])

    def _costs(self, states: Rows, runs: Tensor) -> Tensor:
        """Return 1 for each step that violates the constraint, 0 for the others, `[T, N]`.

        Args:
            states: `[(M + T + 1) * N]`, without terminal states: the last step of an episode has no cost.
            runs: Steps since the last reward or end of an episode, `[T, N]`.
        """
        steps, num_envs = runs.shape
        ends = torch.arange(len(states) - steps * num_envs, len(states), device=runs.device)
        votes = count_votes(
            judge_pairs(self.reachability, states),
            ends,
            runs.flatten(),
            self._lengths,
            stride=num_envs,
            threshold=self.config.vote_threshold,
            needed=self._needed,
        )
        return (votes >= self._needed).view(steps, num_envs).float()

    def costs(self, observations: Tensor) -> Tensor:
        """Return the cost of each step of one stretch without a reward or an ending, `[T]`.

        Args:
            observations: From its first state to its last, `[T + 1, ...]`.
        """
        runs = torch.arange(1, len(observations), device=observations.device).unsqueeze(1)
        blank = torch.zeros_like(observations[:1]).expand(int(self._lengths[-1]), *observations.shape[1:])
        return self._costs(Rows.of(torch.cat((blank, observations))), runs).squeeze(1)

    def weights(self) -> Mapping[str, Any]:
        """Return the parameters that `costs` needs."""
        return {"reachability": self.reachability.weights()}

    def load_weights(self, weights: Mapping[str, Any]) -> None:
        """Take such parameters."""
        self.reachability.load_weights(weights["reachability"])

    def update(self, rollout: Rollout) -> Mapping[str, float]:
        """Train the network; return its metrics and the share of the last rollout's steps that had a cost."""
        return {"violations": self._violations, **self.reachability.update(rollout)}

    def state_dict(self) -> dict[str, Any]:
        """Return the recent states and the network's state."""
        return {
            "recent": self._recent.clone(),
            "runs": self._runs.clone(),
            "violations": self._violations,
            "reachability": self.reachability.state_dict(),
        }

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Restore such a state."""
        device = self._runs.device
        self._recent, self._runs = state["recent"].to(device), state["runs"].to(device)
        self._violations = float(state["violations"])
        self.reachability.load_state_dict(state["reachability"])


def votes_needed(samples: int, quantile: float) -> int:
    """Return the number of votes from which on their quantile (nearest rank) is 1."""
    return samples - round(quantile * (samples - 1))


def _runs(before: Tensor, cuts: Tensor) -> Tensor:
    """Return the number of steps since the last cut, including each step, `[T, N]`; 0 at a cut.

    Args:
        before: The number of steps since the last cut before the rollout, `[N]`.
        cuts: Whether the step ended an episode or was rewarded, `[T, N]` bool.
    """
    steps = torch.arange(1, len(cuts) + 1, device=cuts.device).unsqueeze(1)
    return steps - torch.where(cuts, steps, -before).cummax(dim=0).values


def count_votes(
    judge: Judge, ends: Tensor, runs: Tensor, lengths: Tensor, *, stride: int, threshold: float, needed: int
) -> Tensor:
    """Count the votes for a violation at B states. Counting stops as soon as the result is decided.

    Args:
        judge: Judges pairs of states by their indices.
        ends: Indices of the B states.
        runs: Largest path length to each state without a cut, `[B]`.
        lengths: Path lengths that vote, `[J]`, ascending.
        stride: Difference between the indices of successive states.
        threshold: An answer above this is a vote.
        needed: Number of votes that decide.

    Returns:
        Votes `[B]`. Whether they reach `needed` is exact; the number itself may be too small.
    """
    votes = torch.zeros_like(runs)
    possible = torch.searchsorted(lengths, runs, right=True)  # [B] lengths that fit
    for start in range(0, len(lengths), CHUNK):
        undecided = ((votes < needed) & (votes + possible - start >= needed)).nonzero().squeeze(1)
        part = lengths[start : start + CHUNK]
        rows, columns = (runs[undecided].unsqueeze(1) >= part).nonzero(as_tuple=True)
        later = ends[undecided[rows]]
        reached = judge(later - part[columns] * stride, later) > threshold
        votes.index_add_(0, undecided[rows], reached.long())
    return votes
