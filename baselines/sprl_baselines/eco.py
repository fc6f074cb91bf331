"""ECO: a bonus for states that are unreachable from episodic memory within k steps (Savinov et al. 2019).

The memory of an episode holds the states that were novel when the agent saw them. The reachability network gives the
probability that a remembered state leads to the new state within k steps; the new state's familiarity is a high
quantile of these. The bonus is bonus_weight * (bias - familiarity), and 0 on the step that ends an episode.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import torch
from torch import Tensor

from sprl_baselines.bonus import Setting
from sprl_baselines.learning.config import Count, Share, Weight
from sprl_baselines.learning.rollout import Rollout, Rows
from sprl_baselines.reachability import (
    LARGE,
    Judge,
    LearnedReachability,
    Reachability,
    ReachabilityConfig,
    judge_pairs,
)


@dataclass(frozen=True)
class ECOConfig(ReachabilityConfig):
    """Hyperparameters; the defaults are for the grids."""

    k: Count = 3  # steps within which a state counts as reached (Table 1)
    bonus_weight: Weight = 0.001  # weight of the whole bonus (Table 1)
    bias: float = 0.5  # the bonus is positive where familiarity is below this
    novelty_threshold: Share = 0.5  # a state less familiar than this is remembered
    familiarity_quantile: Share = 0.9  # of the network's answers, interpolated between ranks
    memory_size: Count = 200  # states remembered in an episode; a full memory replaces one at random


class ECO:
    """Episodic curiosity. There is no bonus, and no memory, until the network is accurate enough (`ready`)."""

    privileged: ClassVar[bool] = False

    def __init__(self, setting: Setting, config: ECOConfig) -> None:
        self.config = config
        self.reachability: Reachability = LearnedReachability(setting, config, LARGE)
        self._generator = torch.Generator().manual_seed(setting.seed)
        self._counts = torch.zeros(setting.num_envs, dtype=torch.int64, device=setting.device)  # [N] states remembered
        self._memory = torch.empty(0)  # [M, N, ...]

    def reward(self, rollout: Rollout) -> Tensor:
        """Return bonus_weight * (bias - familiarity) of each step's successor, `[T, N]`; 0 where an episode ends."""
        if not self.reachability.ready:
            return torch.zeros_like(rollout.rewards)
        familiarity = self._familiarity(rollout)
        bonus = self.config.bonus_weight * (self.config.bias - familiarity)
        return bonus.masked_fill(rollout.ended, 0.0)

    def _familiarity(self, rollout: Rollout) -> Tensor:
        """Go through a rollout step by step, store novel states, and return the familiarity of successors, `[T, N]`."""
        memory = self._memory if len(self._memory) else self._blank(rollout)
        states = Rows.of(memory.flatten(0, 1)) + rollout.visited
        episodes = _Episodes(states, self._counts, self.config, self._generator)
        judge = judge_pairs(self.reachability, states)
        familiarity = torch.empty_like(rollout.rewards)
        for step, ended in enumerate(rollout.ended):
            row = self.config.memory_size + step
            episodes.remember(row, episodes.counts == 0)
            familiarity[step] = episodes.familiarity(row + 1, judge)
            episodes.remember(row + 1, (familiarity[step] < self.config.novelty_threshold) & ~ended)
            episodes.counts[ended] = 0
        self._memory, self._counts = episodes.memory(), episodes.counts
        return familiarity

    def _blank(self, rollout: Rollout) -> Tensor:
        first = rollout.observations[:1]
        return torch.zeros_like(first).expand(self.config.memory_size, *first.shape[1:])

    def update(self, rollout: Rollout) -> Mapping[str, float]:
        """Train the network."""
        return {"remembered": float(self._counts.float().mean()), **self.reachability.update(rollout)}

    def state_dict(self) -> dict[str, Any]:
        """Return the memories, the generator's state and the network's state."""
        return {
            "memory": self._memory.clone(),
            "counts": self._counts.clone(),
            "generator": self._generator.get_state(),
            "reachability": self.reachability.state_dict(),
        }

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Restore such a state."""
        device = self._counts.device
        self._memory, self._counts = state["memory"].to(device), state["counts"].to(device)
        self._generator.set_state(state["generator"].cpu())
        self.reachability.load_state_dict(state["reachability"])


class _Episodes:
    """The memories of N running episodes, as indices of states: the earlier memories, then the rollout's states.

    Args:
        states: `[(M + T + 1) * N]`, the first M * N of them the memories.
        counts: Number of states remembered, `[N]`.
        config: Sizes.
        generator: Chooses which state a full memory replaces.
    """

    def __init__(self, states: Rows, counts: Tensor, config: ECOConfig, generator: torch.Generator) -> None:
        self._states, self.counts = states, counts.clone()
        self._config, self._generator = config, generator
        self._envs = torch.arange(len(counts), device=counts.device)
        rows = torch.arange(config.memory_size, device=counts.device)
        self._slots = rows * len(counts) + self._envs.unsqueeze(1)  # [N, M] indices of states

    def remember(self, row: int, wanted: Tensor) -> None:
        """Store the states of a row where `wanted` `[N]` is true."""
        size = self._config.memory_size
        replaced = torch.randint(size, self.counts.shape, generator=self._generator).to(self.counts.device)
        slots = torch.where(self.counts < size, self.counts, replaced)
        here = self._envs[wanted]
        self._slots[here, slots[here]] = row * len(self._envs) + here
        self.counts = (self.counts + wanted).clamp(max=size)

    def familiarity(self, row: int, judge: Judge) -> Tensor:
        """Return the familiarity of the states of a row, `[N]`."""
        filled = torch.arange(int(self.counts.max()), device=self.counts.device) < self.counts.unsqueeze(1)
        envs, slots = filled.nonzero(as_tuple=True)
        answers = torch.full(filled.shape, torch.inf, device=filled.device)
        answers[filled] = judge(self._slots[envs, slots], row * len(self._envs) + envs)
        return _quantile(answers, self.counts, self._config.familiarity_quantile)

    def memory(self) -> Tensor:
        """Return the remembered states, `[M, N, ...]`."""
        return self._states[self._slots.T].expanded()


def _quantile(values: Tensor, counts: Tensor, quantile: float) -> Tensor:
    """Return the quantile of the first `counts` sorted values of each row of `[N, C]`, linear between ranks, `[N]`."""
    ranks = quantile * (counts - 1)
    ordered = values.sort(dim=1).values
    low, high = (ordered.gather(1, rank.long().unsqueeze(1)).squeeze(1) for rank in (ranks.floor(), ranks.ceil()))
    return low + (ranks - ranks.floor()) * (high - low)
