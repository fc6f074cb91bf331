"""The coloured screen of a running episode, from an emulator of its own: drawing never touches the environment."""

from __future__ import annotations

from typing import Any, Final

import ale_py
import numpy as np
import pygame
from ale_py import roms
from numpy.typing import NDArray

from sprl_bench.envs.atari.preprocessing import FRAMES_PER_STEP, METADATA

_SCALE: Final = 3  # of the window

Key = tuple[int, int, int]
"""An episode: the emulator's seed, the episodes before it since then, and its frames without an action."""


class Screen:
    """Replays an episode of one game up to its present, and goes on from there when it is shown again.

    Args:
        game: The game's name in ale-py.
    """

    def __init__(self, game: str) -> None:
        self._game = game
        self._console = ale_py.ALEInterface()
        self._console.setLoggerMode(ale_py.LoggerMode.Error)
        self._console.setFloat("repeat_action_probability", 0.0)
        self._key: Key | None = None
        self._shown: NDArray[np.uint8] = np.empty(0, np.uint8)
        self._window: Any = None

    def reach(self, key: Key, actions: NDArray[np.uint8]) -> None:
        """Play an episode up to the end of `actions` [t]."""
        seen = len(self._shown)
        if self._key != key or seen > len(actions) or (self._shown != actions[:seen]).any():
            self._begin(key)
            seen = 0
        for action in actions[seen:].tolist():
            self._play(action)
        self._key, self._shown = key, actions.copy()

    def _begin(self, key: Key) -> None:
        seed, episodes, no_ops = key
        self._console.setInt("random_seed", seed)
        self._console.loadROM(roms.get_rom_path(self._game))
        for _ in range(episodes + 1):
            self._console.reset_game()
        for _ in range(no_ops):
            self._console.act(0)

    def _play(self, action: int) -> None:
        for _ in range(FRAMES_PER_STEP):
            if not self._console.game_over():
                self._console.act(action)  # ale-py numbers the 18 actions in their order

    def picture(self) -> NDArray[np.uint8]:
        """Return the screen, uint8 [210, 160, 3]."""
        return np.asarray(self._console.getScreenRGB())

    def memory(self) -> NDArray[np.uint8]:
        """Return the console's memory, uint8 [128]."""
        return np.asarray(self._console.getRAM())

    def show(self) -> None:
        """Show the screen in a window."""
        picture = self.picture()
        if self._window is None:
            pygame.display.init()
            height, width = picture.shape[:2]
            self._window = pygame.display.set_mode((width * _SCALE, height * _SCALE))
            pygame.display.set_caption(self._game)
            self._clock = pygame.time.Clock()
        surface = pygame.surfarray.make_surface(picture.swapaxes(0, 1))
        pygame.transform.scale(surface, self._window.get_size(), self._window)
        pygame.event.pump()
        self._clock.tick(METADATA["render_fps"])
        pygame.display.flip()

    def close(self) -> None:
        """Close the window, if there is one."""
        if self._window is not None:
            pygame.display.quit()
            self._window = None
