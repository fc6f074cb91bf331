"""Did you mean: the nearest allowed name, and the sentence that refuses an unknown one."""

from __future__ import annotations

from collections.abc import Iterable
from difflib import get_close_matches
from typing import Final

LISTED: Final = 20  # names that are listed beside a suggestion


def did_you_mean(name: object, allowed: Iterable[object]) -> str:
    """Return "did you mean 'NAME'?" for the allowed text nearest to `name`, or an empty string."""
    by_letters = {choice.lower(): choice for choice in allowed if isinstance(choice, str)}
    short = str(name).lower()
    near = [choice for choice in by_letters if _abbreviates(short, choice)] or get_close_matches(short, by_letters, n=1)
    return f"did you mean {by_letters[near[0]]!r}?" if near else ""


def _abbreviates(short: str, name: str) -> bool:
    """Return whether `short` is the initials of a name, as "lr", or has a piece of each word, as "ent_coef"."""
    pieces, words = short.split("_"), name.split("_")
    if len(words) > 1 and short == "".join(word[:1] for word in words):
        return True
    pairs = list(zip(pieces, words, strict=False))
    begun = all(piece[:1] == word[:1] for piece, word in pairs)
    return len(pieces) == len(words) > 1 and begun and any(piece and word.startswith(piece) for piece, word in pairs)


def unknown(kind: str, name: str, allowed: Iterable[str]) -> str:
    """Return "Unknown KIND 'NAME'...", with the nearest allowed name, and the list unless it is long."""
    names = sorted(allowed)
    hint = did_you_mean(name, names)
    if hint and len(names) > LISTED:
        return f"Unknown {kind} {name!r}; {hint}"
    return f"Unknown {kind} {name!r}; {f'{hint} Allowed' if hint else 'allowed'}: {', '.join(names) or 'none'}."
