"""A window that shows pictures."""

from __future__ import annotations

from typing import Any

import numpy as np
import pygame
from numpy.typing import NDArray


class Window:
    """A window, opened when something is first shown."""

    def __init__(self) -> None:
        self._screen: Any = None
        self._clock = pygame.time.Clock()

    def show(self, picture: NDArray[np.uint8], fps: int) -> None:
        """Show a picture uint8 [H, W, 3], at most `fps` times a second."""
        surface = pygame.surfarray.make_surface(picture.swapaxes(0, 1))
        if self._screen is None:
            pygame.display.init()
            self._screen = pygame.display.set_mode(surface.get_size())
            pygame.display.set_caption("sprl-bench")
        self._screen.blit(surface, (0, 0))
        pygame.event.pump()
        self._clock.tick(fps)
        pygame.display.flip()

    def close(self) -> None:
        """Close the window."""
        if self._screen is not None:
            pygame.display.quit()
            self._screen = None
