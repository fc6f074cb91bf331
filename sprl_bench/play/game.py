"""A game: the keys, the episode so far, and the shortest path from here."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, Final, NamedTuple

import gymnasium
import numpy as np
from numpy.typing import NDArray

from sprl_bench.envs import GRID_IDS
from sprl_bench.envs.checks import check_integer
from sprl_bench.envs.grid.encoding import WALL
from sprl_bench.solver import distances_to_goal, parse, shortest_path
from sprl_bench.suggestions import unknown

ACTIONS: Final[Mapping[str, int]] = MappingProxyType(
    {"left": 0, "right": 1, "up": 2, "p": 3, "d": 4, "space": 5, "enter": 6}
)
"""The action of each key."""
NAMES: Final = ("turn left", "turn right", "forward", "pick up", "drop", "toggle", "done")
HELP: Final = "arrows: turn, forward   p: pick up   d: drop   space: toggle   s: shortest path   r: restart   q: quit"
FORWARD: Final = 2
MOVES: Final = ((1, 0), (0, 1), (-1, 0), (0, -1))  # x and y of one step, by direction
ARROWS: Final = ">v<^"
DOORS: Final = "_DL"  # open, closed, locked


class Outcome(NamedTuple):
    """How an episode ended, or where the player left it."""

    steps: int
    total_reward: float
    is_success: bool


class Game:
    """One person's episodes of a grid task.

    Args:
        env_id: One of `sprl_bench.envs.GRID_IDS`.
        seed: Of the first episode; the others follow from it.

    Attributes:
        outcomes: Of the episodes with at least one step, the current one included.
        is_over: Whether the current episode has ended.
        shows_path: Whether the player wants to see the shortest path.
        quit: Whether the player has left.

    Raises:
        ValueError: The id is that of no grid task, or the seed is negative.
    """

    def __init__(self, env_id: str, seed: int = 0) -> None:
        if env_id not in GRID_IDS:
            raise ValueError(f"{unknown('grid task', env_id, GRID_IDS)} Mazes, Fetch and Atari cannot be played.")
        self._env: gymnasium.Env[Any, Any] = gymnasium.make(env_id, render_mode="rgb_array")
        self._outcomes: list[Outcome] = []
        self.shows_path = self.quit = False
        self._begin(check_integer("seed", seed, 0))

    def _begin(self, seed: int | None = None) -> None:
        self._observation, _ = self._env.reset(seed=seed)
        self._current = Outcome(0, 0.0, is_success=False)
        self.is_over = False

    @property
    def outcomes(self) -> list[Outcome]:
        """Every episode with at least one step."""
        return [one for one in (*self._outcomes, self._current) if one.steps]

    def press(self, key: str) -> None:
        """Do what a key stands for; other keys do nothing."""
        if key == "q":
            self.quit = True
        elif key == "s":
            self.shows_path = not self.shows_path
        elif key == "r":
            self._outcomes.append(self._current)
            self._begin()
        elif key in ACTIONS and not self.is_over:
            self._step(ACTIONS[key])

    def _step(self, action: int) -> None:
        self._observation, reward, terminated, truncated, info = self._env.step(action)
        steps, total, _ = self._current
        self._current = Outcome(steps + 1, total + float(reward), bool(info["is_success"]))
        self.is_over = terminated or truncated

    def status(self) -> list[str]:
        """Return what the player reads: steps, return, and the path or how the episode ended."""
        steps, total, is_success = self._current
        lines = [f"steps {steps}   return {total:g}"]
        if self.is_over:
            lines.append(f"{'Goal reached' if is_success else 'Out of time'}. r: next episode   q: quit")
        elif self.shows_path:
            lines.append(self._describe_path())
        return lines

    def _describe_path(self) -> str:
        """Return the length of a shortest path and its first action."""
        if distances_to_goal(self._observation[None])[0] < 0:
            return "There is no path to the goal."
        path = shortest_path(self._observation)
        return f"shortest path: {len(path)} steps; next: {NAMES[path[0]]}"

    def path_cells(self) -> list[tuple[int, int]]:
        """Return the cells (x, y) ahead on a shortest path; none where it is not shown or does not exist."""
        if not self.shows_path or self.is_over or distances_to_goal(self._observation[None])[0] < 0:
            return []
        state = parse(self._observation[None])
        y, x = divmod(int(state.agent[0]), len(self._observation))
        direction, cells = int(state.direction[0]), []
        for action in shortest_path(self._observation):
            if action == FORWARD:
                x, y = x + MOVES[direction][0], y + MOVES[direction][1]
                cells.append((x, y))
            elif action < FORWARD:
                direction = (direction + (1 if action else -1)) % 4
        return cells

    def picture(self) -> NDArray[np.uint8]:
        """Return the task as pixels: [H, W, 3]."""
        pixels: Any = self._env.render()
        return np.asarray(pixels, np.uint8)

    def text(self) -> list[str]:
        """Return the task as letters, one line a row: walls #, door D or L, key k, goal G, and the agent's arrow."""
        state = parse(self._observation[None])
        size = len(self._observation)
        letters = np.where(self._observation[..., 0] == WALL, "#", " ").astype("<U1").ravel()
        for x, y in self.path_cells():
            letters[y * size + x] = "."
        for cells, letter in (
            (state.door, DOORS[int(state.door_state[0])]),
            (state.key, "k"),
            (state.goal, "G"),
            (state.agent, ARROWS[int(state.direction[0])]),
        ):
            if 0 <= cells[0] < size * size:
                letters[cells[0]] = letter
        return [" ".join(row) for row in letters.reshape(size, size)]

    def close(self) -> None:
        """Close the environment."""
        self._env.close()
