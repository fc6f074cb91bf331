"""How the mazes are played: the compiled functions that start and step them, and restore them from their state."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sprl_bench.envs.compiled import inline, kernel
from sprl_bench.envs.maze.cell_paths import measure
from sprl_bench.envs.maze.levels import FRAMES, GOAL, GOOD, NOTHING, REWARDS
from sprl_bench.envs.maze.motion import CELL, CELL_BITS, REACH, is_inside_wall, move
from sprl_bench.envs.maze.openings import DRAWS, Uniforms, begin, begin_again, take_layout
from sprl_bench.envs.maze.raycast import Columns, draw, new_columns
from sprl_bench.envs.maze.worlds import Cells, Flags, Integers, Rules, Worlds


@inline
def _taken(worlds: Worlds, row: int) -> int:
    """Return the kind of the thing that the agent touches, and take it away if it is an object."""
    for thing in range(worlds.things.shape[1]):
        kind = worlds.things[row, thing, 2]
        x = (worlds.things[row, thing, 0] << CELL_BITS) + CELL // 2 - worlds.poses[row, 0]
        y = (worlds.things[row, thing, 1] << CELL_BITS) + CELL // 2 - worlds.poses[row, 1]
        if kind != NOTHING and x * x + y * y <= REACH * REACH:
            if kind != GOAL:
                worlds.things[row, thing, 2] = NOTHING
                measure(worlds.cells, worlds.things, row, worlds.distances)
            return int(kind)
    return NOTHING


@inline
def _is_done(worlds: Worlds, row: int) -> bool:
    """Return whether all good objects are taken."""
    left = 0
    for thing in range(worlds.things.shape[1]):
        left += worlds.things[row, thing, 2] == GOOD
    return left == 0


@inline
def _act(worlds: Worlds, row: int, action: int, least: int, uniforms: Uniforms) -> float:
    """Take one action and return its reward. A new start ends the action."""
    reward = 0.0
    for _ in range(FRAMES):
        move(worlds.cells, worlds.poses, row, action)
        kind = _taken(worlds, row)
        reward += REWARDS[kind]
        if kind in (GOAL, GOOD):
            worlds.is_success[row] = True
            if kind == GOAL or _is_done(worlds, row):
                begin_again(worlds, row, least, uniforms)
                break
    return reward


@inline
def _draw(frames: Cells, columns: Columns, worlds: Worlds, row: int, rules: Rules) -> None:
    draw(frames, columns, worlds.cells, worlds.poses, worlds.things, worlds.looks, row, rules.fog)


@kernel
def restart(rows: Integers, worlds: Worlds, bank: Cells, rules: Rules, frames: Cells) -> None:
    """Start a new episode in each of `rows`, from its stream, and draw its picture."""
    columns, uniforms = new_columns(), np.empty(DRAWS)
    for row in rows:
        begin(worlds, row, bank, rules, uniforms)
        _draw(frames, columns, worlds, row, rules)


@kernel
def advance(
    start: int,
    stop: int,
    actions: Integers,
    skipped: Flags,
    elapsed: Integers,
    worlds: Worlds,
    rules: Rules,
    frames: Cells,
    rewards: NDArray[np.float64],
    truncations: Flags,
) -> None:
    """Step the mazes from `start` to `stop`; skipped ones do not change and get reward 0.

    `elapsed` already includes this step.
    """
    columns, uniforms = new_columns(), np.empty(DRAWS)
    for row in range(start, stop):
        rewards[row], truncations[row] = 0.0, False
        if not skipped[row]:
            rewards[row] = _act(worlds, row, actions[row], rules.minimum_goal_distance, uniforms)
            truncations[row] = elapsed[row] >= rules.horizon
            _draw(frames, columns, worlds, row, rules)


@kernel
def derive(worlds: Worlds, bank: Cells, rules: Rules, frames: Cells) -> None:
    """Compute all that follows from the state: cells, distances and pictures."""
    columns = new_columns()
    for row in range(worlds.layouts.shape[0]):
        take_layout(worlds, row, bank, worlds.layouts[row])
        measure(worlds.cells, worlds.things, row, worlds.distances)
        _draw(frames, columns, worlds, row, rules)


@kernel
def stands_in_wall(cells: Cells, poses: Integers) -> bool:
    """Return whether any agent, inside its maze, overlaps a wall."""
    found = False
    for row in range(poses.shape[0]):
        found |= is_inside_wall(cells, row, poses[row, 0], poses[row, 1])
    return found
