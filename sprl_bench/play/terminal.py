"""The game in a terminal: letters, and single keys without the enter key."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from types import MappingProxyType
from typing import Final

from sprl_bench.play.game import HELP, Game

CLEAR: Final = "\x1b[H\x1b[2J"
KEYS: Final = MappingProxyType(
    {b"\x1b[A": "up", b"\x1b[C": "right", b"\x1b[D": "left", b" ": "space", b"\r": "enter", b"\n": "enter"}
    | {f"\x1bO{letter}".encode(): key for letter, key in (("A", "up"), ("C", "right"), ("D", "left"))}
)
"""What a terminal sends; letters stand for themselves."""


def play_in_terminal(game: Game) -> None:
    """Let a person play until she quits or closes the terminal.

    Raises:
        ValueError: Input or output is no terminal.
    """
    if not (sys.stdin.isatty() and sys.stdout.isatty()):
        raise ValueError("The game needs a window or a terminal; here is neither.")
    with _single_keys() as descriptor:
        while not game.quit:
            print(CLEAR + "\r\n".join((*game.text(), "", *game.status(), HELP)), end="\r\n", flush=True)
            for key in _keys(os.read(descriptor, 64)):
                game.press(key)


@contextmanager
def _single_keys() -> Iterator[int]:
    """Read keys at once and without an echo; the terminal is restored at the end."""
    import termios  # noqa: PLC0415 - Windows has none
    import tty  # noqa: PLC0415 - likewise

    descriptor = sys.stdin.fileno()
    before = termios.tcgetattr(descriptor)
    try:
        tty.setcbreak(descriptor)
        yield descriptor
    finally:
        termios.tcsetattr(descriptor, termios.TCSADRAIN, before)


def _keys(received: bytes) -> Iterator[str]:
    """Yield the names of the keys; the end of the input quits."""
    if not received:
        yield "q"
    while received:
        length = 3 if received[:3] in KEYS else 1
        yield KEYS.get(received[:length], received[:length].decode("latin-1").lower())
        received = received[length:]
