"""The line of each value in a JSON text, so that an error can name it."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator

Place = tuple[str | int, ...]
"""The keys and indices of a value, from the outside in."""

TOKEN = re.compile(r'"(?:[^"\\]|\\.)*"|[{}\[\]:,]|[^\s{}\[\]:,"]+')


def find_line(text: str, place: Place) -> int:
    """Return the line, from 1, of a value in valid JSON; if it is missing, of the innermost value around its place."""
    lines = dict(values(text))
    depth = next(depth for depth in range(len(place), -1, -1) if place[:depth] in lines)
    return lines[place[:depth]]


def find_duplicate(text: str) -> Place | None:
    """Return the first place that has two values in a valid JSON text, or None."""
    if not _has_duplicate(text):
        return None
    seen: set[Place] = set()
    for place, _ in values(text):
        if place in seen:
            return place
        seen.add(place)
    return None


def _has_duplicate(text: str) -> bool:
    """Return whether any object in a valid JSON text has a key twice; much faster than finding the place."""
    found = False

    def check(pairs: list[tuple[str, object]]) -> None:
        nonlocal found
        found = found or len(dict(pairs)) < len(pairs)

    json.loads(text, object_pairs_hook=check)
    return found


def values(text: str) -> Iterator[tuple[Place, int]]:
    """Yield the place and the line of each value in a valid JSON text, in its order."""
    path: list[str | int] = []
    line, scanned, at_key = 1, 0, False
    for token in TOKEN.finditer(text):
        symbol = token.group()
        line, scanned = line + text.count("\n", scanned, token.start()), token.start()
        if symbol in ("}", "]"):
            path.pop()
            at_key = False
        elif symbol == ",":
            at_key = isinstance(path[-1], str)
            path[-1] = path[-1] if isinstance(path[-1], str) else path[-1] + 1
        elif at_key:
            path[-1], at_key = _unquote(symbol), False
        elif symbol != ":":
            yield tuple(path), line
            if symbol in ("{", "["):
                path.append("" if symbol == "{" else 0)
                at_key = symbol == "{"


def _unquote(symbol: str) -> str:
    return str(json.loads(symbol))
