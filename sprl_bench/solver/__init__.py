"""The exact solver of the grid tasks: shortest paths and reachability on the full state, from observations alone.

The full state is the agent's pose, where the key is (a cell, or in hand) and the door's state. All of it can be
read from an observation: a key out of sight is in hand, a door out of sight is open and under the agent, a goal
out of sight is under the agent and ends the episode. FourRooms has neither key nor door.

Everything takes and gives arrays. Time is counted in env steps; -1 stands for "no way". Breadth-first search does
the work, with one integer for a state, so that the answers are exact and not the product of a heuristic.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sprl_bench.envs.checks import check_integer
from sprl_bench.solver.maps import NOWHERE, Cells, Integers, State, checked_maps, parse
from sprl_bench.solver.search import UNLIMITED, distances_all, num_codes, path_of, solve_all

__all__ = ["State", "distances", "distances_to_goal", "optimal_actions", "parse", "reachable", "shortest_path"]


def distances_to_goal(observations: Cells) -> Integers:
    """Return the number of steps to the goal on a shortest path, int64 [N], from observations uint8 [N, S, S, 3]."""
    return _solved(observations)[0]


def optimal_actions(observations: Cells) -> Integers:
    """Return the first action of a shortest path to the goal, int64 [N]; "done" where there is no path to go."""
    return _solved(observations)[1]


def _solved(observations: Cells) -> tuple[Integers, Integers]:
    """Return the distances to the goal and the first actions, int64 [N] each."""
    observations = checked_maps(observations)
    out, actions = np.empty((2, len(observations)), np.int64)
    solve_all(observations, out, actions)
    return out, actions


def shortest_path(observation: Cells) -> Integers:
    """Return the actions of a shortest path to the goal, int64 [L], from one observation uint8 [S, S, 3].

    Raises:
        ValueError: The goal cannot be reached.
    """
    (cells,) = checked_maps(observation[None])
    out = np.empty(num_codes(len(cells)), np.int64)
    length = path_of(cells, out)
    if length == NOWHERE:
        raise ValueError("There is no path from this state to the goal.")
    return out[:length].copy()


def distances(sources: Cells, targets: Cells, limit: int | None = None) -> Integers:
    """Return the least number of steps from each source's state to its target's, int64 [N].

    Args:
        sources: Observations uint8 [N, S, S, 3].
        targets: Observations uint8 [N, S, S, 3]. One of another map is out of reach.
        limit: Look no further than this number of steps; None for no limit. A small limit saves much time.
    """
    sources, targets = checked_maps(sources, "sources"), checked_maps(targets, "targets")
    if sources.shape != targets.shape:
        raise ValueError(f"sources and targets must have one shape, got {sources.shape} and {targets.shape}.")
    out = np.empty(len(sources), np.int64)
    distances_all(sources, targets, UNLIMITED if limit is None else check_integer("limit", limit, 0), out)
    return out


def reachable(sources: Cells, targets: Cells, k: int) -> NDArray[np.bool_]:
    """Return whether some sequence of at most ``k`` actions leads from each source's state to its target's, bool [N].

    This is the ground-truth reachability network (appendix B.2): every state reaches itself, the relation is
    directed, and a state on the goal, where the episode is over, reaches nothing else.
    """
    return np.not_equal(distances(sources, targets, limit=check_integer("k", k, 0)), NOWHERE)
