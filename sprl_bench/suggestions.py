"""The one sentence that a misspelt name is answered with."""

from __future__ import annotations

from collections.abc import Iterable
from difflib import get_close_matches

__all__ = ["unknown"]


def unknown(kind: str, name: str, allowed: Iterable[str]) -> str:
    """Return "Unknown KIND 'NAME'...", with the nearest allowed name and the whole list."""
    names = sorted(allowed)
    near = get_close_matches(name, names, n=1, cutoff=0.6)
    hint = f"; did you mean {near[0]!r}? Allowed:" if near else "; allowed:"
    return f"Unknown {kind} {name!r}{hint} {', '.join(names) or 'none'}."
