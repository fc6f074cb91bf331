"""The standard streams of a command: open, printable, and without a say in the status of the work."""

from __future__ import annotations

import contextlib
import os
import sys
from collections.abc import Iterator
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final

ASCII: Final = str.maketrans(
    dict(zip("▁▂▃▄▅▆▇█", "_.-:=+*#", strict=True)) | {"─": "-", "━": "-", "…": "~", "†": "+", "‡": "*"}
)
"""For each letter of our tables that is not ASCII, one that is."""
STREAMS: Final = MappingProxyType({"stdin": 0, "stdout": 1, "stderr": 2})


def open_streams() -> None:
    """Open the standard streams that the shell has closed, and let none of them refuse a letter.

    A closed one would otherwise be the number of the next file that is opened, here or in a worker.
    """
    for number in STREAMS.values():
        try:
            os.fstat(number)
        except OSError:
            free = os.open(os.devnull, os.O_RDWR)  # takes the lowest free number, which is this one
            os.set_inheritable(free, True)
    for name, number in STREAMS.items():
        if getattr(sys, name) is None:
            setattr(sys, name, Path(os.devnull).open("w" if number else "r", encoding="utf-8"))  # noqa: SIM115 - stays
        elif number:
            getattr(sys, name).reconfigure(errors="replace")


def legible(text: str, encoding: str | None) -> str:
    """Return `text` with letters that this encoding has."""
    try:
        text.encode(encoding or "ascii")
    except UnicodeEncodeError:
        return text.translate(ASCII)
    return text


@contextlib.contextmanager
def unbreakable_output() -> Iterator[None]:
    """Ignore within that standard output or standard error cannot be written to: the work goes on, and has a status."""
    before = sys.stdout, sys.stderr
    sys.stdout, sys.stderr = Unbreakable(sys.stdout), Unbreakable(sys.stderr)
    try:
        yield
        sys.stdout.flush()
    finally:
        sys.stdout, sys.stderr = before


class Unbreakable:
    """A text stream that is silent once its reader has gone or its disk is full."""

    def __init__(self, stream: Any) -> None:
        self._stream = stream

    def write(self, text: str) -> int:
        """Write, if that is possible."""
        with self._silenced():
            self._stream.write(text)
        return len(text)

    def flush(self) -> None:
        """Flush, if that is possible."""
        with self._silenced():
            self._stream.flush()

    @contextlib.contextmanager
    def _silenced(self) -> Iterator[None]:
        try:
            yield
        except OSError:
            silent = os.open(os.devnull, os.O_WRONLY)
            os.dup2(silent, self._stream.fileno())  # what is still in the buffer goes there
            os.close(silent)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)
