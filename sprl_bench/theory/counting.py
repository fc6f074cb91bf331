"""Exact counts of the trajectories that satisfy the k-shortest-path constraint (Sohn et al. 2021, Lemma 2, Theorem 1).

A small deterministic world is a table of successors, with states that end the episode. There, the trajectories that
satisfy the constraint can be counted exactly. Let s_0, s_1, ... be the states, and D(s, s') the smallest number of
steps from s to s' without a reward before s' (D_nr of Definition 4). A trajectory is *admissible for k* if

    D(s_{t-j}, s_t) = j    for every t and every j from 1 to min(k, t):

every stretch of at most k steps is a shortest path. For k = 0 all trajectories are admissible. Only the goal is
rewarded, and it ends the episode (the single-goal case of appendix I), so no stretch contains a reward before its end.

This is stricter than Definition 6 in two ways. Definition 6 only constrains the stretches before a reward; here, as for
the cost of the algorithm, trajectories without a reward are constrained too. And stretches shorter than k count from
the first step on. Counts are Python integers, exact at any size; shares are their correctly rounded quotients.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from itertools import accumulate
from typing import NamedTuple

import numpy as np

from sprl_bench.envs.checks import check_integer
from sprl_bench.theory.small_worlds import Integers, World, distances

Window = tuple[int, ...]
"""The last states of a trajectory that the constraint depends on, ending with the current one."""


class Counts(NamedTuple):
    """The numbers of admissible trajectories from the start with t = 0 .. T steps.

    Two actions with the same successor give two trajectories: the trajectories are the nodes of the rollout tree.
    """

    running: tuple[int, ...]  # [T + 1] with t steps, not on the goal
    ended: tuple[int, ...]  # [T + 1] that reach the goal at step t

    @property
    def trajectories(self) -> tuple[int, ...]:
        """Trajectories of t steps, and the shorter ones that have ended: the leaves of the tree of depth t, [T + 1].

        A trajectory with no admissible next step is not counted beyond its last step.
        """
        return tuple(a + b for a, b in zip(self.running, accumulate(self.ended), strict=True))

    @property
    def tree_sizes(self) -> tuple[int, ...]:
        """Nodes of the rollout tree of depth t, including its root, [T + 1]."""
        return tuple(accumulate(a + b for a, b in zip(self.running, self.ended, strict=True)))


def is_admissible(trajectory: Sequence[int], table: Integers, k: int) -> bool:
    """Return whether every stretch of at most k steps is a shortest path, by the definition.

    Args:
        trajectory: States, [L + 1].
        table: The distances between all states, [S, S].
        k: The longest constrained stretch; 0 for no constraint.
    """
    check_integer("k", k, 0)
    return all(
        table[trajectory[t - j], trajectory[t]] == j for t in range(len(trajectory)) for j in range(1, min(k, t) + 1)
    )


class _Constraint:
    """The admissible next states. It is enough to check the longest stretch that ends there.

    If D(s_{t-m}, s_t) = m for a path of m steps, then every stretch inside it is a shortest path too.
    """

    def __init__(self, world: World, k: int) -> None:
        self._k = check_integer("k", k, 0)
        self._successors: list[list[int]] = world.successors.tolist()
        self._distances: list[list[int]] = distances(world).tolist()

    def options(self, window: Window) -> list[int]:
        """Return the admissible next states, once for each action with that successor."""
        if not self._k:
            return self.successors(window)
        reach = self._distances[window[0]]
        return [state for state in self.successors(window) if reach[state] == len(window)]

    def successors(self, window: Window) -> list[int]:
        """Return all next states, one for each action."""
        return self._successors[window[-1]]

    def extend(self, window: Window, state: int) -> Window:
        """Return the last k states, or the last one for k = 0."""
        return (*window, state)[-max(self._k, 1) :]


def count_trajectories(world: World, k: int, horizon: int) -> Counts:
    """Count the admissible trajectories from the start by dynamic programming over their last k states.

    Trajectories with the same last k states have the same continuations, so only their number is stored.

    Args:
        world: The world.
        k: The longest stretch that must be a shortest path; 0 counts all trajectories.
        horizon: T, the largest number of steps.
    """
    constraint = _Constraint(world, k)
    counts: Counter[Window] = Counter({(world.start,): 1})
    running, ended = [], []
    for step in range(check_integer("horizon", horizon, 0) + 1):
        if step:
            counts = _advance(counts, constraint)
        arrived = counts.total()
        counts = Counter({window: count for window, count in counts.items() if not world.goal[window[-1]]})
        running.append(counts.total())
        ended.append(arrived - running[-1])
    return Counts(tuple(running), tuple(ended))


def _advance(counts: Counter[Window], constraint: _Constraint) -> Counter[Window]:
    """Return the number of trajectories by their last states, one step later."""
    after: Counter[Window] = Counter()
    for window, count in counts.items():
        for state in constraint.options(window):
            after[constraint.extend(window, state)] += count
    return after


def shares(world: World, k: int, horizon: int) -> list[float]:
    """Return the share of admissible trajectories for each number of steps, [T + 1].

    It never increases with k: an admissible trajectory is admissible for every smaller k (Lemma 2).
    """
    admissible = count_trajectories(world, k, horizon).trajectories
    everything = count_trajectories(world, 0, horizon).trajectories
    return [some / every for some, every in zip(admissible, everything, strict=True)]


def steps_to_goal(
    world: World, k: int, rng: np.random.Generator, *, episodes: int = 1000, limit: int = 100_000
) -> Integers:
    """Simulate a random explorer that satisfies the constraint; return its steps until the goal, [episodes].

    It draws uniformly from the actions that keep the trajectory admissible. If there is none, it forgets all states but
    the current one, as if an episode started there. If there is still none, it draws from all actions.

    Args:
        world: The world.
        k: The longest stretch that must be a shortest path; 0 for a uniform random walk.
        rng: Generator of its draws.
        episodes: Number of walks.
        limit: Largest number of steps; a walk that is stopped there counts as that many.
    """
    check_integer("episodes", episodes, 1)
    check_integer("limit", limit, 1)
    constraint = _Constraint(world, k)
    goals = frozenset(np.flatnonzero(world.goal).tolist())
    return np.asarray([_walk(world.start, goals, constraint, rng, limit) for _ in range(episodes)])


def _walk(start: int, goals: frozenset[int], constraint: _Constraint, rng: np.random.Generator, limit: int) -> int:
    """Return the number of steps of one walk until a goal."""
    window: Window = (start,)
    for step in range(limit):
        if window[-1] in goals:
            return step
        options = constraint.options(window)
        if not options:
            window = window[-1:]
            options = constraint.options(window) or constraint.successors(window)
        window = constraint.extend(window, options[int(rng.random() * len(options))])
    return limit
