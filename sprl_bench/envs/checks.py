"""Checks of arguments. Every error is one sentence: the argument, its value, and what is allowed."""

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
"""The arguments of every batched engine."""
NEVER: Final = np.iinfo(np.int64).max
"""A number of steps that no episode reaches."""


def check_integer(name: str, value: object, low: int, high: int | None = None) -> int:
    """Return `value` as an int if it is an integer (not a bool) from `low` to `high`, both included.

    Raises:
        TypeError: `value` is not an integer.
        ValueError: `value` is out of range.
    """
    allowed = f"an integer of at least {low}" if high is None else f"an integer from {low} to {high}"
    try:
        number = operator.index(value)  # type: ignore[arg-type]  # this tests whether it is an integer
    except TypeError:
        number = None
    if number is None or isinstance(value, bool):
        raise TypeError(f"{name} is {value!r}; it must be {allowed}.")
    if number < low or (high is not None and number > high):
        raise ValueError(f"{name} is {value!r}; it must be {allowed}.")
    return number


def check_choice(name: str, value: object, allowed: Iterable[object]) -> None:
    """Check that `value` is one of `allowed`; the error suggests the nearest one.

    Raises:
        ValueError: It is not.
    """
    choices = list(allowed)
    if value not in choices:
        listed = ", ".join(repr(choice) for choice in choices)
        raise ValueError(f"{name} is {value!r}; it must be one of {listed}.{_suggestion(value, choices)}")


def refuse_unknown(
    where: str, unknown: Mapping[str, Any], allowed: Iterable[str], elsewhere: Mapping[str, str] = MappingProxyType({})
) -> None:
    """Raise an error for unknown keyword arguments; it suggests the nearest known name.

    It begins with Python's own words, because libraries look for them: TorchRL tries again without `frameskip`.

    Args:
        where: The name of the class or function that was called.
        unknown: The unknown arguments; no error if it is empty.
        allowed: The names of known arguments.
        elsewhere: Other projects' names for arguments, with the names used here.

    Raises:
        TypeError: `unknown` is not empty.
    """
    known = sorted(allowed)
    for name, value in unknown.items():
        raise TypeError(
            f"{where}() got an unexpected keyword argument {name!r} (value {value!r}); it takes {', '.join(known)}."
            f"{_suggestion(elsewhere.get(name, name), known)}"
        )


def refuse_unknown_of_engine(
    where: str, arguments: Mapping[str, Any], own: Iterable[str], elsewhere: Mapping[str, str] = MappingProxyType({})
) -> None:
    """Do the same for a batched engine, which takes the arguments of every engine and some of its own.

    Raises:
        TypeError: One of `arguments` is none of every engine.
    """
    unknown = {name: value for name, value in arguments.items() if name not in VECTOR_ARGUMENTS}
    refuse_unknown(where, unknown, {*own, *VECTOR_ARGUMENTS}, elsewhere)


def check_entries(name: str, value: object, expected: Iterable[str]) -> None:
    """Check that `value` is a mapping with exactly the `expected` entries.

    Raises:
        ValueError: It is not.
    """
    names = sorted(expected)
    if not isinstance(value, Mapping) or sorted(value) != names:
        got = sorted(value) if isinstance(value, Mapping) else type(value).__name__
        raise ValueError(f"{name} is {got}; it must be a mapping with exactly the entries {names}.")


def check_array(name: str, value: object, shape: tuple[int, ...], dtype: np.dtype[Any]) -> None:
    """Check that `value` is an array of this shape and type.

    Raises:
        ValueError: It is not.
    """
    if not isinstance(value, np.ndarray) or value.shape != shape or value.dtype != dtype:
        got = f"{value.dtype} {value.shape}" if isinstance(value, np.ndarray) else type(value).__name__
        raise ValueError(f"{name} is {got}; it must be an array {dtype} {shape}.")


def checked_autoreset_mode(value: object) -> AutoresetMode:
    """Return the autoreset mode, given as Gymnasium's enum or as its string.

    Raises:
        ValueError: It is neither.
    """
    if not isinstance(value, AutoresetMode):
        check_choice("autoreset_mode", value, [mode.value for mode in AutoresetMode])
    return AutoresetMode(value)


def checked_time_limit(max_episode_steps: int | None) -> int:
    """Return the limit, or `NEVER` if there is none.

    Raises:
        TypeError, ValueError: It is not a positive integer, None or -1.
    """
    if max_episode_steps is None or (max_episode_steps == -1 and not isinstance(max_episode_steps, bool)):
        return NEVER
    return check_integer("max_episode_steps", max_episode_steps, 1)


def checked_mask(options: Mapping[str, Any] | None, num_envs: int, *, first: bool) -> NDArray[np.bool_]:
    """Return which sub-environments to reset, bool [N].

    Args:
        options: The options of `reset`.
        num_envs: Number of sub-environments N.
        first: Whether this is the first reset.

    Raises:
        TypeError, ValueError: `options["reset_mask"]` is not a mask [N] with at least one True.
        ResetNeeded: The first reset leaves out a sub-environment.
    """
    if options is None or "reset_mask" not in options:
        return np.ones(num_envs, np.bool_)
    mask = options["reset_mask"]
    if not isinstance(mask, np.ndarray) or mask.dtype != np.bool_:
        got = mask.dtype if isinstance(mask, np.ndarray) else type(mask).__name__
        raise TypeError(f"options['reset_mask'] is {got}; it must be a NumPy array of bool.")
    if mask.shape != (num_envs,) or not mask.any():
        raise ValueError(f"options['reset_mask'] is {mask!r}; it must have shape ({num_envs},) and at least one True.")
    if first and not mask.all():
        raise ResetNeeded("The first reset() must reset all sub-environments.")
    return mask


def _suggestion(value: object, choices: Iterable[object]) -> str:
    """Return " Did you mean ...?" with the choice nearest to `value`, or nothing if none is near."""
    hint = did_you_mean(value, choices)
    return f" D{hint[1:]}" if hint else ""
