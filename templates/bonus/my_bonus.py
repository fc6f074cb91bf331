"""PPO with a bonus of your own: copy this folder, rename it, change `reward`.

This one pays bonus_weight / sqrt(n) for an observation that the run has seen n times.
"""

from collections import Counter
from dataclasses import dataclass
from hashlib import blake2b

import numpy as np
import torch

from sprl_baselines.agents import LearningAgentFactory
from sprl_baselines.learning.config import Config, Weight


@dataclass(frozen=True)
class SeenConfig(Config):
    """Hyperparameters beside PPO's: each can be given by --set, in a variant's name and in a sweep."""

    bonus_weight: Weight = 0.01  # of an observation that was never seen


class Seen:
    """The bonus. `sprl_baselines.bonus.Bonus` says what each method has to do."""

    privileged = False  # True if it uses more than observations and rewards

    def __init__(self, setting, config):
        """Build what depends on the spaces: setting.observation_space, .action_space, .num_envs, .seed, .device."""
        self.config, self.counts = config, Counter()

    def reward(self, rollout):
        """Return the bonus of each step, [T, N]; rollout.next_observations is [T, N, ...]."""
        seen = [self.counts[key] + 1 for key in _keys(rollout)]
        return (self.config.bonus_weight / torch.tensor(seen).sqrt()).view_as(rollout.rewards).to(rollout.rewards)

    def update(self, rollout):
        """Learn from the rollout, and return numbers to log."""
        self.counts.update(_keys(rollout))
        return {"seen_observations": float(len(self.counts))}

    def state_dict(self):
        """Return what later rewards depend on, so that an interrupted run continues: arrays, tensors, numbers."""
        return {"keys": np.array([*self.counts], np.uint64), "counts": np.array([*self.counts.values()], np.int64)}

    def load_state_dict(self, state):
        """Take such a state."""
        self.counts = Counter(dict(zip(map(int, state["keys"]), map(int, state["counts"]), strict=True)))


def _keys(rollout):
    """Return a number for each of the T * N observations, the same for equal ones."""
    rows = rollout.next_observations.flatten(0, 1).cpu().numpy()
    return [int.from_bytes(blake2b(row.tobytes(), digest_size=8).digest()) for row in rows]


seen = LearningAgentFactory("seen", Seen, SeenConfig)
