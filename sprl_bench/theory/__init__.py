"""The shortest-path constraint on small worlds, exactly: what it prunes, and that the optimum satisfies it.

`small_worlds.py` has deterministic worlds and their distances; `counting.py` counts what the constraint leaves (Section
6.6); `values.py` has stochastic worlds, values and optimal policies; `options.py` has what leads from one reward to the
next, and checks the constraint of a policy (Theorem 1). Nothing is trained.
"""

from __future__ import annotations

from sprl_bench.theory.counting import Counts, count_trajectories, is_admissible, shares, steps_to_goal
from sprl_bench.theory.options import (
    best_masses,
    lost_masses,
    path_chances,
    policy_distances,
    satisfies_constraint,
    transition_masses,
    visited,
)
from sprl_bench.theory.small_worlds import (
    World,
    cardinal_world,
    distances,
    key_world,
    num_reachable,
    pose_world,
    shortest_path,
)
from sprl_bench.theory.values import (
    RewardedWorld,
    best_policy,
    best_values,
    policy_transitions,
    policy_values,
    rewarded,
)

__all__ = [
    "Counts",
    "RewardedWorld",
    "World",
    "best_masses",
    "best_policy",
    "best_values",
    "cardinal_world",
    "count_trajectories",
    "distances",
    "is_admissible",
    "key_world",
    "lost_masses",
    "num_reachable",
    "path_chances",
    "policy_distances",
    "policy_transitions",
    "policy_values",
    "pose_world",
    "rewarded",
    "satisfies_constraint",
    "shares",
    "shortest_path",
    "steps_to_goal",
    "transition_masses",
    "visited",
]
