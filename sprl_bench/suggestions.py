"""Did you mean: the nearest allowed name, and the sentence that refuses an unknown one."""

from __future__ import annotations

from collections.abc import Iterable
from difflib import get_close_matches
from typing import Final

LISTED: Final = 20  # names that are listed beside a suggestion


def did_you_mean(name: object, allowed: Iterable[object]) -> str:
    """Return "did you mean 'NAME'?" for the allowed text nearest to `name`, or an empty string."""
    by_letters = {choice.lower(): choice for choice in allowed if isinstance(choice, str)}
    near = get_close_matches(str(name).lower(), by_letters, n=1)
    return f"did you mean {by_letters[near[0]]!r}?" if near else ""


def unknown(kind: str, name: str, allowed: Iterable[str]) -> str:
    """Return "Unknown KIND 'NAME'...", with the nearest allowed name, and the list unless it is long."""
    names = sorted(allowed)
    hint = did_you_mean(name, names)
    if hint and len(names) > LISTED:
        return f"Unknown {kind} {name!r}; {hint}"
    return f"Unknown {kind} {name!r}; {f'{hint} Allowed' if hint else 'allowed'}: {', '.join(names) or 'none'}."
