"""The ways of a policy from one state to another without a reward in between, as options (appendices H, I and J).

A *non-rewarding path* from s to s' meets s' only at its end, and no reward before it. Under a policy, let l be the
length of such a path. Then

- its *chance* is the probability that the policy goes such a path at all,
- its *transition mass* is E[discount^l], where other ways count as 0,
- its *pi-distance* is log(mass / chance) / log(discount) (Definition 3): l, where the path is certain.

Values follow from the masses alone: those from s to each rewarding state s', times what s' pays and is worth.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from sprl_bench.theory.small_worlds import Flags
from sprl_bench.theory.values import Floats, RewardedWorld, policy_transitions

TOLERANCE: Final = 1e-9  # of masses, which are at most 1


def transition_masses(world: RewardedWorld, policy: Floats) -> Floats:
    """Return the transition mass from each state to each state, [S, S]."""
    return _summed(world, policy_transitions(world, policy), world.discount)


def path_chances(world: RewardedWorld, policy: Floats) -> Floats:
    """Return the chance of a non-rewarding path from each state to each state, [S, S]."""
    return _summed(world, policy_transitions(world, policy), 1.0)


def policy_distances(world: RewardedWorld, policy: Floats) -> Floats:
    """Return the pi-distance from each state to each state, [S, S]; infinite where there is no path."""
    chances, masses = path_chances(world, policy), transition_masses(world, policy)
    out = np.full_like(masses, np.inf)
    there = chances > 0
    out[there] = np.log(masses[there] / chances[there]) / np.log(world.discount)
    return out


def best_masses(world: RewardedWorld) -> Floats:
    """Return the highest transition mass from each state to each state that any policy has, [S, S]."""
    states = len(world.rewards)
    moves = np.where(world.ends[:, None, None], 0.0, world.transitions)
    goes_on = _goes_on(world)
    masses = np.zeros((states, states))
    while True:
        paid = np.eye(states) + np.where(goes_on, masses, 0.0)  # [next state, target]
        better: Floats = world.discount * (moves @ paid).max(axis=1)
        if np.abs(better - masses).max() <= TOLERANCE * 1e-3:
            return masses
        masses = better


def lost_masses(world: RewardedWorld, policy: Floats) -> Floats:
    """Return what a policy loses of the highest masses, [S, S]: between visited states and rewarding ones, else 0.

    Only pairs that the policy connects count (Definition 6). The shortest-path constraint holds if nothing is lost: in
    a deterministic world a mass is discount^length, and a shortest path to a reward has no detour inside.
    """
    masses = transition_masses(world, policy)
    connected = (masses > 0) & world.rewarding & visited(world, policy)[:, None]
    return np.where(connected, best_masses(world) - masses, 0.0)


def satisfies_constraint(world: RewardedWorld, policy: Floats) -> bool:
    """Return whether a policy reaches its rewards by shortest paths (Definition 6)."""
    return bool((lost_masses(world, policy) <= TOLERANCE).all())


def visited(world: RewardedWorld, policy: Floats) -> Flags:
    """Return whether a policy ever comes to a state from the start, [S]."""
    leads_to = policy_transitions(world, policy) > 0
    found = np.arange(len(leads_to)) == world.start
    while (more := found | (found @ leads_to)).sum() > found.sum():
        found = more
    return np.asarray(found)


def _goes_on(world: RewardedWorld) -> Flags:
    """Return whether a non-rewarding path to a target may pass a state, [S, target]."""
    passes = ~(world.rewarding | world.ends)
    return np.asarray(passes[:, None] & ~np.eye(len(passes), dtype=np.bool_))


def _summed(world: RewardedWorld, moves: Floats, discount: float) -> Floats:
    """Return the sum over all non-rewarding paths of their probability times discount^length, [S, S]."""
    goes_on = _goes_on(world)
    return np.stack([_to(target, moves, goes_on[:, target], discount) for target in range(len(moves))], axis=1)


def _to(target: int, moves: Floats, goes_on: Flags, discount: float) -> Floats:
    """Return this sum for one target, [S].

    The equations are solved for the states that lead there: the others may circle for ever, and have 0.
    """
    leads = moves[:, target] > 0
    while (more := leads | ((moves > 0) @ (leads & goes_on))).sum() > leads.sum():
        leads = more
    out = np.zeros(len(moves))
    rows = np.flatnonzero(leads)
    through = moves[np.ix_(rows, rows)] * goes_on[rows]
    out[rows] = np.linalg.solve(np.eye(len(rows)) - discount * through, discount * moves[rows, target])
    return out
