"""Reachability: whether one state leads to another within k steps, learned from experience or searched for exactly.

SPRL prices steps by it and ECO tells new from known by it. `replay.py` keeps what was seen, `triplets.py` draws from it
what to learn from (Algorithm 1), `network.py` is the function, `learned.py` trains it on a schedule and says when it
may be trusted, `ground_truth.py` needs none of these (appendix B.2), and `pairs.py` asks either about many pairs.
"""

from __future__ import annotations

from sprl_baselines.reachability.ground_truth import GroundTruth
from sprl_baselines.reachability.hyperparameters import HorizonConfig, ReachabilityConfig
from sprl_baselines.reachability.learned import LearnedReachability
from sprl_baselines.reachability.pairs import Judge, Reachability, judge_pairs

__all__ = [
    "GroundTruth",
    "HorizonConfig",
    "Judge",
    "LearnedReachability",
    "Reachability",
    "ReachabilityConfig",
    "judge_pairs",
]
