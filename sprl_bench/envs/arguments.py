"""Checks of what a user passes in: each refusal is one sentence that names the argument, its value and the choice."""

from __future__ import annotations

import difflib
import operator
from collections.abc import Iterable, Mapping
from types import MappingProxyType
from typing import Any

import numpy as np

__all__ = ["check_array", "check_choice", "check_entries", "check_integer", "refuse_unknown"]


def check_integer(name: str, value: object, low: int, high: int | None = None) -> int:
    """Return ``value`` as an int if it is an integer (not a bool) from ``low`` to ``high``, both included.

    Raises:
        TypeError: ``value`` is not an integer.
        ValueError: ``value`` is out of range.
    """
    allowed = f"an integer of at least {low}" if high is None else f"an integer from {low} to {high}"
    try:
        number = operator.index(value)  # type: ignore[arg-type]  # the question is whether it has one
    except TypeError:
        number = None
    if number is None or isinstance(value, bool):
        raise TypeError(f"{name} must be {allowed}, got {value!r} of type {type(value).__name__}.")
    if number < low or (high is not None and number > high):
        raise ValueError(f"{name} must be {allowed}, got {value!r}.")
    return number


def check_choice(name: str, value: object, allowed: Iterable[object]) -> None:
    """Refuse a ``value`` that is not one of ``allowed``, with the nearest one suggested.

    Raises:
        ValueError: ``value`` is none of ``allowed``.
    """
    choices = list(allowed)
    if value not in choices:
        listed = ", ".join(repr(choice) for choice in choices)
        raise ValueError(f"{name} must be one of {listed}, got {value!r}.{_suggestion(value, choices)}")


def refuse_unknown(
    where: str, unknown: Mapping[str, Any], allowed: Iterable[str], elsewhere: Mapping[str, str] = MappingProxyType({})
) -> None:
    """Refuse keyword arguments that ``where`` does not take, with the nearest known name suggested.

    Args:
        where: What was called.
        unknown: What it was given and does not take; nothing happens if it is empty.
        allowed: What it takes.
        elsewhere: The name that an argument has here, by one that it has elsewhere.

    Raises:
        TypeError: ``unknown`` is not empty.
    """
    known = sorted(allowed)
    for name, value in unknown.items():
        raise TypeError(
            f"{where} takes no argument {name!r} (got {name}={value!r}); it takes {', '.join(known)}."
            f"{_suggestion(elsewhere.get(name, name), known)}"
        )


def check_entries(name: str, value: object, expected: Iterable[str]) -> None:
    """Refuse a ``value`` that is not a mapping with exactly the ``expected`` entries.

    Raises:
        ValueError: It is not.
    """
    names = sorted(expected)
    if not isinstance(value, Mapping) or sorted(value) != names:
        got = sorted(value) if isinstance(value, Mapping) else type(value).__name__
        raise ValueError(f"{name} must have exactly the entries {names}, got {got}.")


def check_array(name: str, value: object, shape: tuple[int, ...], dtype: np.dtype[Any]) -> None:
    """Refuse a ``value`` that is not an array of this shape and type.

    Raises:
        ValueError: It is not.
    """
    if not isinstance(value, np.ndarray) or value.shape != shape or value.dtype != dtype:
        got = f"{value.dtype} {value.shape}" if isinstance(value, np.ndarray) else type(value).__name__
        raise ValueError(f"{name} must be an array {dtype} {shape}, got {got}.")


def _suggestion(value: object, choices: Iterable[object]) -> str:
    """Return a question that offers the choice nearest to ``value``, or nothing if none is near."""
    by_name = {str(choice).lower(): choice for choice in choices if isinstance(choice, str)}
    nearest = difflib.get_close_matches(str(value).lower(), by_name, n=1)
    return f" Did you mean {by_name[nearest[0]]!r}?" if nearest else ""
