"""SPRL: a cost on steps that end a stretch which was not a shortest path (Sohn et al. 2021).

A policy that obeys the k-shortest-path constraint never takes more than k steps where k would have done. So a state
that could have been reached within k steps from one that lies further back than k shows a violation: with c = 1 there
and 0 elsewhere, the bonus is cost_scale * (bias - c). Stretches are compared only where no reward and no ending lies
between their ends, and several lengths k + tolerance, k + 2 tolerance, ... vote, so that one wrong answer of the
network does no harm (appendix A.2, E.3).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from sprl_baselines.bonus import Setting
from sprl_baselines.learning.config import Count, Share, Weight
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

CHUNK = 8  # lengths judged at a time: few enough to stop early, enough to fill a batch


@dataclass(frozen=True)
class ConstraintConfig(HorizonConfig):
    """Hyperparameters of the cost; those of the grids are the defaults."""

    tolerance_samples: Count = 60  # lengths that vote: k + tolerance, k + 2 tolerance, ... (Table 1)
    vote_threshold: Share = 0.5  # an answer above this is a vote: the earlier state leads to the later within k steps
    vote_quantile: Share = 0.9  # this quantile of the votes decides (appendix E.3)
    cost_scale: Weight = 0.002  # weight of the whole bonus (Table 1)
    bias: float = 0.5  # what a step earns before its cost is taken off


@dataclass(frozen=True)
class SPRLConfig(ConstraintConfig, ReachabilityConfig):
    """The cost, and the network that finds violations."""


class SPRL:
    """The cost of violations of the constraint, as far as reachability finds them; nothing before that is ready.

    Args:
        setting: Where it works.
        config: Hyperparameters of the cost.
        reachability: Tells what lies within k steps.
    """

    def __init__(self, setting: Setting, config: ConstraintConfig, reachability: Reachability) -> None:
        self.config, self.reachability = config, reachability
        self.privileged = reachability.privileged
        lengths = config.k + config.tolerance * torch.arange(1, config.tolerance_samples + 1)
        self._lengths = lengths.to(setting.device)  # [J]
        self._needed = votes_needed(config.tolerance_samples, config.vote_quantile)
        self._recent = torch.empty(0)  # [M, N, ...] the last states, as many as the longest stretch has steps
        self._runs = torch.zeros(setting.num_envs, dtype=torch.int64, device=setting.device)  # [N] steps since a cut
        self._violations = 0.0  # share of the last rollout's steps

    @classmethod
    def learned(cls, setting: Setting, config: SPRLConfig) -> SPRL:
        """Let a network find the violations."""
        return cls(setting, config, LearnedReachability(setting, config))

    @classmethod
    def true(cls, setting: Setting, config: ConstraintConfig) -> SPRL:
        """Search for them on the grid's full state, from the first step on (appendix B.2)."""
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
        return self.config.cost_scale * (self.config.bias - costs)

    def _blank(self, rollout: Rollout) -> Tensor:
        """Return as many states as the longest stretch has steps, all zero, for the first rollout, `[M, N, ...]`."""
        first = rollout.observations[:1]
        return torch.zeros_like(first).expand(int(self._lengths[-1]), *first.shape[1:])

    def _costs(self, states: Rows, runs: Tensor) -> Tensor:
        """Return 1 for each step that ends a violation, 0 for the others, `[T, N]`.

        Args:
            states: `[(M + T + 1) * N]`; a terminal state is never among them, nor is it ever priced.
            runs: Steps since the last ending or reward, `[T, N]`.
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

    def update(self, rollout: Rollout) -> Mapping[str, float]:
        """Let the network learn, and return the share of steps that the last rollout was charged for."""
        return {"violations": self._violations, **self.reachability.update(rollout)}

    def state_dict(self) -> dict[str, Any]:
        """Return the open stretches and the network's state."""
        return {
            "recent": self._recent.clone(),
            "runs": self._runs.clone(),
            "violations": self._violations,
            "reachability": self.reachability.state_dict(),
        }

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Take such a state."""
        device = self._runs.device
        self._recent, self._runs = state["recent"].to(device), state["runs"].to(device)
        self._violations = float(state["violations"])
        self.reachability.load_state_dict(state["reachability"])


def votes_needed(samples: int, quantile: float) -> int:
    """Return how many of the votes must say yes for their quantile, the nearest one by rank, to say so."""
    return samples - round(quantile * (samples - 1))


def _runs(before: Tensor, cuts: Tensor) -> Tensor:
    """Return the steps since the last cut, up to and including each step, `[T, N]`; 0 at a cut.

    Args:
        before: The same up to the first of these steps, `[N]`.
        cuts: Whether the step ended an episode or was rewarded, `[T, N]` bool.
    """
    steps = torch.arange(1, len(cuts) + 1, device=cuts.device).unsqueeze(1)
    return steps - torch.where(cuts, steps, -before).cummax(dim=0).values


def count_votes(
    judge: Judge, ends: Tensor, runs: Tensor, lengths: Tensor, *, stride: int, threshold: float, needed: int
) -> Tensor:
    """Count over how many lengths a state could have been reached sooner, no further than the verdict needs.

    Args:
        judge: Judges pairs of states by their indices.
        ends: Indices of B states.
        runs: Steps that their stretches may have at most, `[B]`.
        lengths: Of the stretches that vote, `[J]`, ascending.
        stride: Difference between the indices of successive states.
        threshold: What an answer must exceed to be a vote.
        needed: Votes that decide.

    Returns:
        Votes `[B]`: whether they are enough is exact, the number may fall short of the truth.
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
