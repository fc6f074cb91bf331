"""Hyperparameters of reachability; the defaults are for the grids."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated

from sprl_baselines.learning.config import Choice, Config, Count, Positive, Range, Share, Weight
from sprl_baselines.reachability.network import PAIR_INPUTS
from sprl_baselines.reachability.triplets import NEGATIVES

Whole = Annotated[int, Range(0)]


@dataclass(frozen=True)
class HorizonConfig(Config):
    """The horizon of reachability."""

    k: Count = 2  # steps within which a state counts as reached (Table 1)
    tolerance: Count = 1  # further steps that are tolerated (Table 1)


@dataclass(frozen=True)
class ReachabilityConfig(HorizonConfig):
    """The network, its training data and its schedule."""

    positive_bias: Count = 5  # the next anchor lies 1 to this many steps after the positive (Table 1)
    negative_bias: Whole = 20  # negatives lie at least k plus this many steps after their anchor (Table 1)
    # "episode": negatives lie up to the end of the episode (Algorithm 1); "double": from k + tolerance + the bias to
    # k + tolerance + double the bias, the range on which accuracy is measured (appendix B.1)
    negatives: Annotated[str, Choice(*NEGATIVES)] = "episode"
    replay_size: Count = 60_000  # env steps in the replay (appendix B.1)
    train_every: Count = 6_000  # env steps between two trainings, at first (appendix E.3)
    later_from: Whole = 0  # env steps after which `train_every_later` holds; 0 for never
    train_every_later: Count = 12_000  # env steps between two trainings from then on
    last_from: Whole = 0  # env steps after which `train_every_last` holds; 0 for never
    train_every_last: Count = 36_000  # env steps between two trainings from then on
    max_pairs: Count = 8_000  # largest number of pairs in a training
    pair_batch: Annotated[int, Range(4)] = 128  # pairs in a gradient step, half of them positive
    reachability_learning_rate: Positive = 0.0003  # Adam's step size
    weight_decay: Weight = 0.0  # L2 penalty of weights, without biases and normalisation (appendix F.3)
    label_smoothing: Share = 0.0  # the two targets differ by 1 minus this (appendix F.3)
    pair_input: Annotated[str, Choice(*PAIR_INPUTS)] = "pair"  # both states, or the later one and the "difference"
    embedding_units: Count = 128  # of the layer that embeds a grid; its CReLU gives twice as many features
    head_layers: Count = 2  # hidden layers over a pair
    head_units: Count = 128  # width of each
    ready_trainings: Count = 20  # number of last trainings whose mean accuracy decides readiness
    ready_accuracy: Share = 0.75  # the network is used once this mean accuracy is exceeded
    accuracy_pairs: Count = 15_000  # positives, and as many negatives, that accuracy is measured on (appendix B.1)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.pair_batch > self.max_pairs:
            raise ValueError(
                f"Hyperparameter pair_batch is {self.pair_batch}; it must be at most max_pairs, {self.max_pairs}."
            )

    def wait(self, num_envs: int, rollout_length: int) -> int:
        """Return the env steps before which the network is not in use: the end of the training that may be trusted.

        The first training waits until half of the replay is full. It holds while `train_every` does.
        """
        half_full = max(self.replay_size // num_envs, 1) // 2 // rollout_length + 1
        between = math.ceil(self.train_every / (num_envs * rollout_length))
        rollouts = max(half_full, between) + (self.ready_trainings - 1) * between
        return rollouts * num_envs * rollout_length
