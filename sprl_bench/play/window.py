"""The game in a window, by pygame, which comes with Minigrid."""

from __future__ import annotations

from typing import Any, Final

from sprl_bench.play.game import HELP, Game

SIDE: Final = 560  # pixels, of the task
LINE: Final = 24  # pixels, of a line of text
FRAMES: Final = 30  # a second
PAPER: Final = (255, 255, 255)
INK: Final = (20, 20, 20)
PATH: Final = (230, 159, 0)
WIDE: Final = {"return": "enter"}


def can_open_window() -> bool:
    """Return whether this machine has a display."""
    import pygame  # noqa: PLC0415 - slow to load, and prints a notice

    try:
        pygame.display.init()
    except pygame.error:
        return False
    return True


def play_in_window(game: Game) -> None:
    """Let a person play until she quits or closes the window."""
    import pygame  # noqa: PLC0415 - slow to load

    pygame.init()
    try:
        screen = pygame.display.set_mode((max(SIDE, 8 * len(HELP)), SIDE + 4 * LINE))
        pygame.display.set_caption("sprl-bench play")
        clock, font = pygame.time.Clock(), pygame.font.Font(None, 22)
        while not game.quit:
            _draw(screen, font, game)
            pygame.display.flip()
            for event in pygame.event.get():
                _handle(event, game)
            clock.tick(FRAMES)
    finally:
        pygame.quit()


def _handle(event: Any, game: Game) -> None:
    import pygame  # noqa: PLC0415 - slow to load

    if event.type == pygame.QUIT:
        game.quit = True
    elif event.type == pygame.KEYDOWN:
        name = pygame.key.name(event.key)
        game.press(WIDE.get(name, name))


def _draw(screen: Any, font: Any, game: Game) -> None:
    """Draw the task, the path on it, and the lines below."""
    import pygame  # noqa: PLC0415 - slow to load

    screen.fill(PAPER)
    task = pygame.surfarray.make_surface(game.picture().swapaxes(0, 1))
    screen.blit(pygame.transform.scale(task, (SIDE, SIDE)), (0, 0))
    cell = SIDE / len(game.text())
    for x, y in game.path_cells():
        pygame.draw.circle(screen, PATH, ((x + 0.5) * cell, (y + 0.5) * cell), cell / 8)
    for number, line in enumerate((*game.status(), HELP)):
        screen.blit(font.render(line, True, INK), (8, SIDE + 8 + number * LINE))
