"""Checks of what a user passes in: each refusal is one sentence that names the argument, its value and the choice."""

from __future__ import annotations

import operator
from collections.abc import Iterable, Mapping
from types import MappingProxyType
from typing import Any, Final

import numpy as np
from gymnasium.error import ResetNeeded
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from sprl_bench.suggestions import did_you_mean

VECTOR_ARGUMENTS: Final = ("num_envs", "autoreset_mode", "num_threads", "max_episode_steps", "render_mode", "copy")
"""What every batched engine takes."""
NEVER: Final = np.iinfo(np.int64).max
"""A number of steps that no episode reaches."""


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


def checked_autoreset_mode(value: object) -> AutoresetMode:
    """Return the mode that Gymnasium's enum or its string names.

    Raises:
        ValueError: It names none.
    """
    if not isinstance(value, AutoresetMode):
        check_choice("autoreset_mode", value, [mode.value for mode in AutoresetMode])
    return AutoresetMode(value)


def checked_time_limit(max_episode_steps: int | None) -> int:
    """Return the limit, or ``NEVER`` where there is none.

    Raises:
        TypeError, ValueError: It is neither a positive integer nor None nor -1.
    """
    if max_episode_steps is None or (max_episode_steps == -1 and not isinstance(max_episode_steps, bool)):
        return NEVER
    return check_integer("max_episode_steps", max_episode_steps, 1)


def checked_mask(options: Mapping[str, Any] | None, num_envs: int, *, first: bool) -> NDArray[np.bool_]:
    """Return which sub-environments to reset, bool [N].

    Args:
        options: As ``reset`` takes them.
        num_envs: Number of sub-environments N.
        first: Whether nothing has been reset yet.

    Raises:
        TypeError, ValueError: ``options["reset_mask"]`` is no mask of N with at least one True.
        ResetNeeded: The first reset leaves out a sub-environment.
    """
    if options is None or "reset_mask" not in options:
        return np.ones(num_envs, np.bool_)
    mask = options["reset_mask"]
    if not isinstance(mask, np.ndarray) or mask.dtype != np.bool_:
        got = mask.dtype if isinstance(mask, np.ndarray) else type(mask).__name__
        raise TypeError(f"options['reset_mask'] must be a NumPy array of bool, got {got}.")
    if mask.shape != (num_envs,) or not mask.any():
        raise ValueError(f"options['reset_mask'] must have shape ({num_envs},) and at least one True, got {mask!r}.")
    if first and not mask.all():
        raise ResetNeeded("The first reset() must reset all sub-environments.")
    return mask


def _suggestion(value: object, choices: Iterable[object]) -> str:
    """Return a question that offers the choice nearest to ``value``, or nothing if none is near."""
    hint = did_you_mean(value, choices)
    return f" D{hint[1:]}" if hint else ""
