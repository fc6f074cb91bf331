"""ECO: a bonus for what no remembered state of the episode leads to (Savinov et al. 2019).

Each episode fills a memory with states that were novel when they came. A new state's familiarity is a high quantile of
how likely the remembered ones lead to it; the bonus is bonus_weight * (bias - familiarity), and it is 0 on the step
that ends an episode.
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
from sprl_baselines.reachability import Judge, LearnedReachability, Reachability, ReachabilityConfig, judge_pairs


@dataclass(frozen=True)
class ECOConfig(ReachabilityConfig):
    """Hyperparameters; those of the grids are the defaults."""

    k: Count = 3  # steps within which a state counts as reached (Table 1)
    bonus_weight: Weight = 0.001  # weight of the whole bonus (Table 1)
    bias: float = 0.5  # what a step earns before its familiarity is taken off
    novelty_threshold: Share = 0.5  # a state less familiar than this is remembered
    familiarity_quantile: Share = 0.9  # of the answers, interpolated between ranks
    memory_size: Count = 200  # states that an episode remembers; a full memory replaces one at random


class ECO:
    """Episodic curiosity. It pays nothing, and remembers nothing, until the network may be trusted."""

    privileged: ClassVar[bool] = False

    def __init__(self, setting: Setting, config: ECOConfig) -> None:
        self.config = config
        self.reachability: Reachability = LearnedReachability(setting, config)
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
        """Walk through a rollout, remembering what is novel, `[T, N]`."""
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
        """Let the network learn."""
        return {"remembered": float(self._counts.float().mean()), **self.reachability.update(rollout)}

    def state_dict(self) -> dict[str, Any]:
        """Return the episodes' memories, the generator's state and the network's."""
        return {
            "memory": self._memory.clone(),
            "counts": self._counts.clone(),
            "generator": self._generator.get_state(),
            "reachability": self.reachability.state_dict(),
        }

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Take such a state."""
        device = self._counts.device
        self._memory, self._counts = state["memory"].to(device), state["counts"].to(device)
        self._generator.set_state(state["generator"].cpu())
        self.reachability.load_state_dict(state["reachability"])


class _Episodes:
    """The memories of N open episodes, as indices into the states of a rollout and what was remembered before it.

    Args:
        states: `[(M + T + 1) * N]`, the first M * N of them the memories.
        counts: States remembered, `[N]`.
        config: Sizes.
        generator: Chooses what a full memory replaces.
    """

    def __init__(self, states: Rows, counts: Tensor, config: ECOConfig, generator: torch.Generator) -> None:
        self._states, self.counts = states, counts.clone()
        self._config, self._generator = config, generator
        self._envs = torch.arange(len(counts), device=counts.device)
        rows = torch.arange(config.memory_size, device=counts.device)
        self._slots = rows * len(counts) + self._envs.unsqueeze(1)  # [N, M] indices of states

    def remember(self, row: int, wanted: Tensor) -> None:
        """Remember the states of a row where it is wanted, `[N]` bool."""
        size = self._config.memory_size
        replaced = torch.randint(size, self.counts.shape, generator=self._generator).to(self.counts.device)
        slots = torch.where(self.counts < size, self.counts, replaced)
        here = self._envs[wanted]
        self._slots[here, slots[here]] = row * len(self._envs) + here
        self.counts = (self.counts + wanted).clamp(max=size)

    def familiarity(self, row: int, judge: Judge) -> Tensor:
        """Return the quantile of how likely the remembered states lead to those of a row, `[N]`."""
        filled = torch.arange(int(self.counts.max()), device=self.counts.device) < self.counts.unsqueeze(1)
        envs, slots = filled.nonzero(as_tuple=True)
        answers = torch.full(filled.shape, torch.inf, device=filled.device)
        answers[filled] = judge(self._slots[envs, slots], row * len(self._envs) + envs)
        return _quantile(answers, self.counts, self._config.familiarity_quantile)

    def memory(self) -> Tensor:
        """Return the remembered states themselves, `[M, N, ...]`."""
        return self._states[self._slots.T].expanded()


def _quantile(values: Tensor, counts: Tensor, quantile: float) -> Tensor:
    """Return the quantile of the finite values, `counts` in each row of `[N, C]`, linear between ranks, `[N]`."""
    ranks = quantile * (counts - 1)
    ordered = values.sort(dim=1).values
    low, high = (ordered.gather(1, rank.long().unsqueeze(1)).squeeze(1) for rank in (ranks.floor(), ranks.ceil()))
    return low + (ranks - ranks.floor()) * (high - low)
