"""Hyperparameters as frozen dataclasses: a field's type holds its range, and every value is checked."""

from __future__ import annotations

import math
import sys
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from typing import Annotated, Any, Self, get_args, get_origin, get_type_hints

from sprl_bench.suggestions import unknown


@dataclass(frozen=True)
class Range:
    """An interval of numbers; `open_low` excludes its lower end."""

    low: float
    high: float = math.inf
    open_low: bool = False

    def __contains__(self, value: float) -> bool:
        return (self.low < value if self.open_low else self.low <= value) and value <= self.high

    def __str__(self) -> str:
        floor = f"above {self.low:g}" if self.open_low else f"at least {self.low:g}"
        return floor if math.isinf(self.high) else f"{floor} and at most {self.high:g}"


class Choice(tuple[str, ...]):
    """A choice among words."""

    __slots__ = ()

    def __new__(cls, *words: str) -> Self:
        """Allow these words."""
        return super().__new__(cls, words)

    def __str__(self) -> str:
        return "one of " + ", ".join(map(repr, self))


Count = Annotated[int, Range(1)]
Share = Annotated[float, Range(0, 1)]
Weight = Annotated[float, Range(0)]
Positive = Annotated[float, Range(0, open_low=True)]


class Config:
    """Base of the hyperparameter dataclasses. It checks every field against its annotation."""

    def __post_init__(self) -> None:
        for name, annotation in get_type_hints(type(self), include_extras=True).items():
            object.__setattr__(self, name, _checked(name, getattr(self, name), annotation))

    @classmethod
    def names(cls) -> tuple[str, ...]:
        """Return the names of the hyperparameters, in the order of declaration."""
        return tuple(field.name for field in fields(cls))  # type: ignore[arg-type]  # subclasses are dataclasses

    @classmethod
    def pick(cls, values: Mapping[str, Any]) -> Self:
        """Make the config from `values`. Names of other configs are ignored; missing ones have their defaults."""
        return cls(**{name: values[name] for name in cls.names() if name in values})

    def check_rollout(self, num_steps: int) -> None:
        """Check the hyperparameters that depend on the rollout size. The base class has none.

        Raises:
            ValueError: A hyperparameter is too large for rollouts of `num_steps` env steps.
        """

    def wait(self, num_envs: int, rollout_length: int) -> int:  # noqa: ARG002 - the base class waits for nothing
        """Return the env steps before which what these hyperparameters describe is not in use."""
        return 0

    def as_dict(self) -> dict[str, Any]:
        """Return all hyperparameters as plain values that JSON can hold."""
        return asdict(self)  # type: ignore[call-overload,no-any-return]  # subclasses are dataclasses


def reject_more_than_rollout(name: str, minibatches: int, num_steps: int) -> None:
    """Raise a `ValueError` where hyperparameter `name` asks for more minibatches than a rollout has env steps."""
    if minibatches > num_steps:
        raise ValueError(
            f"Hyperparameter {name} is {minibatches}; it must be at most num_envs * rollout_length, {num_steps}."
        )


def reject_unknown(kind: str, given: Mapping[str, Any], allowed: tuple[str, ...]) -> None:
    """Raise a `ValueError` for the first key of `given` that is not allowed; it suggests the nearest allowed name."""
    for name in given:
        if name not in allowed:
            raise ValueError(unknown(kind, name, allowed))


def _checked(name: str, value: Any, annotation: Any) -> Any:
    """Return the value in its declared type, or raise a `ValueError`."""
    base, *rules = get_args(annotation) if get_origin(annotation) is Annotated else (annotation,)
    if base is float and type(value) is int and abs(value) <= _LARGEST:
        value = float(value)
    sound = type(value) is base and (base is not float or math.isfinite(value))
    if not (sound and all(value in rule for rule in rules)):
        allowed = ", ".join((_KINDS[base], *map(str, rules)))
        raise ValueError(f"Hyperparameter {name} is {value!r}; it must be {allowed}.")
    return value


_LARGEST = sys.float_info.max
_KINDS = {int: "a whole number", float: "a finite number", bool: "true or false", str: "text"}
