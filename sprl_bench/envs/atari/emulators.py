"""N emulators of one game, on ale-py's vector interface, that can be set to any point of any episode.

ale-py cannot save the state of its vector interface. But an episode is a function of the emulator's last seed, the
number of resets since then, and the episode's actions. These three are the state here, and a replay restores it. A
seed makes the emulator load the game again, which takes as long as some hundred steps: one serves `BLOCK` episodes.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final, NamedTuple

import ale_py
import numpy as np
from ale_py import roms
from numpy.typing import NDArray

from sprl_bench.envs.atari.preprocessing import HORIZON, SETTINGS

BLOCK: Final = 32
"""Episodes that follow from one seed of an emulator."""
NUM_SEEDS: Final = 2**31
_CONTINUE: Final = -1  # in place of a seed: ale-py continues its random stream
_NEVER: Final = -2  # in place of a seed: no reset

Mask = NDArray[np.bool_]
Rows = NDArray[np.int64]


class Outcome(NamedTuple):
    """The results of one step of N emulators."""

    observations: NDArray[np.uint8]  # [N, 4, 84, 84], the last one of an episode that has ended
    rewards: NDArray[np.float64]  # [N] points
    terminated: Mask  # [N] the game is over


class Emulators:
    """N emulators of one game.

    Args:
        game: The game's name in ale-py, such as "ms_pacman".
        size: Number of emulators N.
        same_step: Whether an emulator starts its next episode in the step that ends one, or in the step after that.
        num_threads: Threads that share the work.

    Attributes:
        newest: Current observations, uint8 [N, 4, 84, 84]: of the next episode where an emulator has started it.
        no_ops: Frames without an action at the start of the running episodes, int64 [N].
        arrays: The state: the last `seeds` int64 [N], the `episodes` started since then int64 [N] (from 0, or -1
            before the first seed), the `actions` of the running episode uint8 [N, HORIZON], and the number of these
            `taken` int64 [N].
    """

    def __init__(self, game: str, size: int, *, same_step: bool = False, num_threads: int = 1) -> None:
        self.game, self.size = game, size
        self._same_step, self._num_threads = same_step, num_threads
        self._interface = ale_py.ALEVectorInterface(
            rom_path=roms.get_rom_path(game),
            num_envs=size,
            num_threads=num_threads,
            autoreset_mode="SameStep" if same_step else "NextStep",
            **SETTINGS,
        )
        self._strengths = np.ones(size, np.float32)
        self._is_over = np.zeros(size, np.bool_)  # ale-py starts the next episode itself
        self._late = np.full(size, _NEVER, np.int64)  # seeds of those to reset after the next step
        self.newest: NDArray[np.uint8] = np.empty(0, np.uint8)
        self.no_ops = np.zeros(size, np.int64)
        self.arrays: dict[str, NDArray[Any]] = {
            "seeds": np.zeros(size, np.int64),
            "episodes": np.full(size, -1, np.int64),
            "actions": np.zeros((size, HORIZON), np.uint8),
            "taken": np.zeros(size, np.int64),
        }

    def renew(self, rows: Rows) -> None:
        """Let the next episodes of the emulators `rows` start from a new seed."""
        self.arrays["episodes"][rows] = -1

    def restart(self, rows: Rows, generators: Sequence[np.random.Generator]) -> None:
        """Start the next episodes of the emulators `rows`; row r draws its seeds from `generators[r]`."""
        self._reset(rows, self._count(rows, generators))

    def follow(self, rows: Rows, generators: Sequence[np.random.Generator]) -> None:
        """Start the next episodes of the emulators `rows` by the mode: in this step, or in the next one.

        Where the game is over, ale-py does it; here are those with a new seed or with a game that goes on.
        """
        seeds = self._count(rows, generators)
        is_ours = (seeds != _CONTINUE) | ~self._is_over[rows]
        if self._same_step:
            self._reset(rows[is_ours], seeds[is_ours])
        else:
            self._late[rows[is_ours]] = seeds[is_ours]

    def _count(self, rows: Rows, generators: Sequence[np.random.Generator]) -> Rows:
        """Count the next episodes of the emulators `rows`; return their seeds, drawn where a block ends."""
        episodes = self.arrays["episodes"][rows] + 1
        is_seeded = (episodes == 0) | (episodes == BLOCK)
        for row in rows[is_seeded].tolist():
            self.arrays["seeds"][row] = int(generators[row].random() * NUM_SEEDS)
        self.arrays["episodes"][rows] = np.where(is_seeded, 0, episodes)
        self.arrays["taken"][rows] = 0
        return np.where(is_seeded, self.arrays["seeds"][rows], _CONTINUE)

    def step(self, actions: Rows, is_running: Mask) -> Outcome:
        """Take one action [N] in each emulator whose episode is running; the others start their next episode."""
        running = np.flatnonzero(is_running)
        self.arrays["actions"][running, self.arrays["taken"][running]] = actions[running]
        self.arrays["taken"][running] += 1
        rewards, terminated, infos = self._send(actions, ~is_running)
        observations = self.newest
        if self._same_step and terminated.any():
            observations = np.where(terminated[:, None, None, None], infos["final_obs"], self.newest)
        if len(running) < self.size:
            self._reset_late()
            observations = self.newest
        self._is_over = terminated & is_running
        return Outcome(observations, rewards.astype(np.float64), self._is_over)

    def _send(self, actions: Rows, is_first: Mask) -> tuple[Any, Mask, dict[str, Any]]:
        """Step all emulators; those of `is_first` start an episode."""
        self._interface.send(np.ascontiguousarray(actions, np.int32), self._strengths)
        self.newest, rewards, terminated, _, infos = self._interface.recv()
        started = terminated if self._same_step else is_first
        if started.any():
            self.no_ops[started] = infos["episode_frame_number"][started]
        return rewards, terminated, infos

    def _reset_late(self) -> None:
        rows = np.flatnonzero(self._late != _NEVER)
        self._reset(rows, self._late[rows])
        self._late[rows] = _NEVER

    def _reset(self, rows: Rows, seeds: Rows) -> None:
        """Reset the emulators `rows`, with a seed [len(rows)] or `_CONTINUE` for each."""
        if len(rows):
            self.newest, infos = self._interface.reset(rows, seeds)
            self.no_ops[rows] = infos["episode_frame_number"][rows]

    def replay(self) -> None:
        """Play all emulators to the point that `arrays` describes.

        All episodes are replayed side by side and end together. An emulator whose episode is shorter starts it later.
        """
        taken, actions, everyone = self.arrays["taken"], self.arrays["actions"], np.arange(self.size)
        longest = int(taken.max())
        self._is_over[:], self._late[:] = False, _NEVER
        self._reset(everyone, self.arrays["seeds"])  # ale-py's first reset is one of all
        for step in range(longest + 1):
            place = step - (longest - taken)
            self._reach_episode(np.flatnonzero(place == 0))
            if step < longest:
                _, self._is_over, _ = self._send(np.where(place >= 0, actions[everyone, place.clip(0)], 0), place < 0)

    def _reach_episode(self, rows: Rows) -> None:
        """Start the running episodes of the emulators `rows` again."""
        self._reset(rows, self.arrays["seeds"][rows])
        episodes = self.arrays["episodes"][rows]
        for episode in range(1, int(episodes.max(initial=0)) + 1):
            later = rows[episodes >= episode]
            self._reset(later, np.full(len(later), _CONTINUE))

    def __getstate__(self) -> dict[str, Any]:
        arrays = {name: values.copy() for name, values in self.arrays.items()}
        arguments = {"same_step": self._same_step, "num_threads": self._num_threads}
        return {"arguments": {"game": self.game, "size": self.size, **arguments}, "arrays": arrays}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__init__(**state["arguments"])  # type: ignore[misc]  # ale-py's interface cannot be copied
        self.arrays = state["arrays"]
        if (self.arrays["episodes"] >= 0).all():
            self.replay()
