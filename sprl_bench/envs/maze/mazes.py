"""N mazes of one level: their arrays, and the calls that start, step and restore them.

The single environment has one maze, the engine N. Both get their pictures and rewards from the same compiled functions.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sprl_bench.envs.maze import play
from sprl_bench.envs.maze.directions import DIRECTIONS
from sprl_bench.envs.maze.levels import BAD, GOAL, GOOD, NOTHING, NUM_LAYOUTS, PLACE, UNITS_A_CELL, Level
from sprl_bench.envs.maze.maze_bank import Layouts, layouts
from sprl_bench.envs.maze.maze_rules import Variant
from sprl_bench.envs.maze.motion import CELL, CELL_BITS, TOP_SPEED
from sprl_bench.envs.maze.raycast import KEY_BITS, LOOK_KEY, NUM_SURFACES, SURFACE_VALUES
from sprl_bench.envs.maze.textures import PATTERNS
from sprl_bench.envs.maze.worlds import Rules, Worlds, new_worlds

Array = NDArray[Any]
Integers = NDArray[np.int64]


class Mazes:
    """The arrays of N mazes.

    Args:
        level: Their level.
        variant: The arguments of the environment.
        frames: Where pictures are drawn, uint8 [N, 84, 84, 3].
    """

    def __init__(self, level: Level, variant: Variant, frames: NDArray[np.uint8]) -> None:
        self.level, self.rules, self.frames = level, variant.rules(level), frames
        self.worlds = new_worlds(len(frames), level.size, level.num_things)

    @property
    def bank(self) -> Layouts:
        """All layouts of the level, uint8 [NUM_LAYOUTS, S, S]."""
        return layouts(self.level.name)

    def restart(self, rows: Integers) -> None:
        """Start a new episode in these rows."""
        play.restart(rows, self.worlds, self.bank, self.rules, self.frames)

    def parts(self) -> tuple[Worlds, Rules, NDArray[np.uint8]]:
        """Return what `play.advance` needs of this object."""
        return self.worlds, self.rules, self.frames

    def restore(self) -> None:
        """Compute what follows from the state, after the state was changed."""
        play.derive(self.worlds, self.bank, self.rules, self.frames)

    def information(self) -> dict[str, Array]:
        """Return what `info` holds, by name: [N, ...]."""
        x, y = self.worlds.poses[:, 0], self.worlds.poses[:, 1]
        distances = self.worlds.distances[np.arange(len(x)), y >> CELL_BITS, x >> CELL_BITS]
        position = np.stack([x, y], axis=1) * UNITS_A_CELL >> CELL_BITS
        return {"is_success": self.worlds.is_success, "position": position, "goal_distance": distances}

    def check_state(self, state: Mapping[str, Array]) -> None:
        """Check the values of a state, whose names, shapes and types are right.

        Raises:
            ValueError: It cannot occur.
        """
        if not _within(state["layouts"], 0, NUM_LAYOUTS - 1):
            raise ValueError(f"state['layouts'] is out of range; it must be from 0 to {NUM_LAYOUTS - 1}.")
        cells = self.bank[state["layouts"]]
        self._check_poses(state["poses"], cells)
        self._check_things(state["things"], cells)
        looks = state["looks"]
        surfaces = looks[:, :LOOK_KEY].reshape(-1, NUM_SURFACES, SURFACE_VALUES)
        patterns, colours, keys = surfaces[..., 0], surfaces[..., 1:], looks[:, LOOK_KEY]
        if not (_within(patterns, 0, len(PATTERNS) - 1) and _within(colours, 0, 255) and _within(keys, 0, 2**KEY_BITS)):
            raise ValueError("state['looks'] is out of range; it must be patterns, colours and a key.")

    def _check_poses(self, poses: Integers, cells: Layouts) -> None:
        inside = _within(poses[:, :2], CELL, (self.level.size - 1) * CELL - 1)
        if not (inside and _within(poses[:, 2], 0, DIRECTIONS - 1) and _within(poses[:, 3:], -TOP_SPEED, TOP_SPEED)):
            raise ValueError("state['poses'] is out of range; it must be x, y in the maze, an angle and a velocity.")
        if play.stands_in_wall(cells, poses):
            raise ValueError("state['poses'] has an agent inside a wall; it must be on free cells.")

    def _check_things(self, things: Integers, cells: Layouts) -> None:
        x, y, kinds = (things[..., column] for column in range(3))
        inside = _within(things[..., :2], 0, self.level.size - 1)
        if not inside or not (cells[np.arange(len(things))[:, None], y, x] == PLACE).all():
            raise ValueError("state['things'] has a thing elsewhere; it must be on the places of the layout.")
        allowed, sought = ((GOAL,), GOAL) if self.level.has_goal else ((NOTHING, GOOD, BAD), GOOD)
        if not np.isin(kinds, allowed).all() or not (kinds == sought).any(axis=1).all():
            raise ValueError(f"state['things'] has another kind; it must be of {allowed}, with {sought} among them.")


def _within(values: Array, low: int, high: int) -> bool:
    return bool(((values >= low) & (values <= high)).all())
