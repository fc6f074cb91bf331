"""Reachability: whether one state leads to another within k steps, learned from experience or by exact search.

SPRL and ECO use it. `replay.py` stores recent states, `triplets.py` draws training pairs from them (Algorithm 1),
`network.py` is the network, `residual.py` its part for images, `learned.py` trains it on a schedule and decides when it
is ready, `ground_truth.py` is the exact search (appendix B.2), and `pairs.py` holds the interface of both.
"""

from __future__ import annotations

from sprl_baselines.reachability.ground_truth import GroundTruth
from sprl_baselines.reachability.hyperparameters import HorizonConfig, ReachabilityConfig
from sprl_baselines.reachability.learned import LearnedReachability
from sprl_baselines.reachability.pairs import Judge, Reachability, judge_pairs
from sprl_baselines.reachability.residual import LARGE

__all__ = [
    "LARGE",
    "GroundTruth",
    "HorizonConfig",
    "Judge",
    "LearnedReachability",
    "Reachability",
    "ReachabilityConfig",
    "judge_pairs",
]
