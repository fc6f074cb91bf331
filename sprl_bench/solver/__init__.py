"""The exact solver of the grid tasks: shortest paths and reachability on the full state, from observations only.

The full state is the agent's pose, the key's position (a cell, or carried) and the door's state. An observation
contains it: a key that is not visible is carried; a door that is not visible is open, with the agent in it; a goal that
is not visible is under the agent, and the episode has ended. FourRooms has no key and no door.

All functions take and return arrays. Distances are in env steps; -1 means unreachable. The solver is a breadth-first
search with one integer for each state, so the results are exact.

`maze_player` has shortest paths and a competent player for the mazes, which need the environment itself.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sprl_bench.envs.checks import check_integer
from sprl_bench.solver.maps import NOWHERE, Cells, Integers, State, checked_maps, parse
from sprl_bench.solver.maze_player import maze_actions, maze_distances
from sprl_bench.solver.search import UNLIMITED, distances_all, num_codes, path_of, solve_all

__all__ = [
    "State",
    "distances",
    "distances_to_goal",
    "maze_actions",
    "maze_distances",
    "optimal_actions",
    "parse",
    "reachable",
    "shortest_path",
]


def distances_to_goal(observations: Cells) -> Integers:
    """Return the number of steps to the goal on a shortest path, int64 [N], from observations uint8 [N, S, S, 3]."""
    return _solved(observations)[0]


def optimal_actions(observations: Cells) -> Integers:
    """Return the first action of a shortest path to the goal, int64 [N]; "done" at the goal or without a path."""
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
        raise ValueError("observation has no path to the goal; it must have one.")
    return out[:length].copy()


def distances(sources: Cells, targets: Cells, limit: int | None = None) -> Integers:
    """Return the smallest number of steps from each source's state to its target's, int64 [N].

    Args:
        sources: Observations uint8 [N, S, S, 3].
        targets: Observations uint8 [N, S, S, 3]. A target on another map is unreachable.
        limit: Largest distance to search; None for no limit. A small limit is much faster.
    """
    sources, targets = checked_maps(sources, "sources"), checked_maps(targets, "targets")
    if sources.shape != targets.shape:
        raise ValueError(f"targets has shape {targets.shape}; it must be of the shape of sources, {sources.shape}.")
    out = np.empty(len(sources), np.int64)
    distances_all(sources, targets, UNLIMITED if limit is None else check_integer("limit", limit, 0), out)
    return out


def reachable(sources: Cells, targets: Cells, k: int) -> NDArray[np.bool_]:
    """Return whether some sequence of at most `k` actions leads from each source's state to its target's, bool [N].

    This is the ground-truth reachability network (appendix B.2). Every state reaches itself. The relation is not
    symmetric. A state on the goal reaches nothing else, because the episode has ended.
    """
    return np.not_equal(distances(sources, targets, limit=check_integer("k", k, 0)), NOWHERE)
