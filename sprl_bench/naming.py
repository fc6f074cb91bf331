"""How an agent is named: what makes it, a preset, and what differs from the preset, as in `sprl@tuned+k=3`."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, Self

FORM = "AGENT, AGENT@PRESET or AGENT@PRESET+KEY=VALUE"
NEXT_DIFFERENCE = re.compile(r"\+(?=\w*=)")  # the plus of 1e+3 begins none


@dataclass(frozen=True)
class AgentName:
    """The name of an agent, in its parts.

    Attributes:
        source: The name of an installed agent, or "package.module:factory".
        preset: The name of a preset; empty for the agent's own.
        differences: The hyperparameters that differ from the preset.
    """

    source: str
    preset: str = ""
    differences: Mapping[str, Any] = field(default_factory=lambda: MappingProxyType({}))

    @classmethod
    def parse(cls, text: str) -> Self:
        """Read a name such as "sprl", "sprl@tuned", "sprl+k=5" or "my_agent:Walker@tuned+k=3+tolerance=25".

        Raises:
            ValueError: It is no such name; the message names the part that is wrong.
        """
        agent, *settings = NEXT_DIFFERENCE.split(text)
        source, at, preset = agent.partition("@")
        if at and not preset:
            raise ValueError(f"agents holds {text!r}; it must have the name of a preset after the @.")
        if not source or "+" in agent:
            raise ValueError(f"agents holds {text!r}; it must be {FORM}.")
        return cls(source, preset, parse_settings(settings, f"agents holds {text!r}, where a difference"))

    @property
    def plain(self) -> str:
        """The name without its differences, as tables show it: a module's path is left out."""
        name = self.source.partition(":")[2].replace(".", "-") or self.source
        return f"{name}@{self.preset}" if self.preset else name

    def __str__(self) -> str:
        """Return the name as tables and folders show it, with the differences in alphabetical order."""
        return self.plain + self._suffix

    @property
    def full(self) -> str:
        """The name as it can be parsed again: with a module's path."""
        return self.source + (f"@{self.preset}" if self.preset else "") + self._suffix

    @property
    def _suffix(self) -> str:
        return "".join(f"+{key}={_text(self.differences[key])}" for key in sorted(self.differences))


def _text(value: Any) -> str:
    """Return a value as `parse_settings` reads it."""
    return value if isinstance(value, str) else json.dumps(value, separators=(",", ":")).replace("e+", "e")


def parse_settings(settings: Sequence[str], option: str = "--set") -> dict[str, object]:
    """Return the values of "key=value" settings: each as JSON if it is valid JSON, else as text.

    Args:
        settings: What to read.
        option: Where they come from, for messages.

    Raises:
        ValueError: There is no "=", a key is given twice, or a value is missing or not finite.
    """
    chosen: dict[str, object] = {}
    for setting in settings:
        key, equals, value = setting.partition("=")
        if not equals or not key:
            raise ValueError(f"{option} is {setting!r}; it must be KEY=VALUE.")
        if key in chosen:
            raise ValueError(f"{option} gives {key!r} twice.")
        chosen[key] = _value(f"{option} {key}", value)
    return chosen


def _value(name: str, text: str) -> object:
    try:
        value = json.loads(text)
    except json.JSONDecodeError:
        return text
    except (RecursionError, ValueError):
        raise ValueError(f"{name} is {text[:40]!r}...; it must be shorter or less nested.") from None
    try:
        json.dumps(value, allow_nan=False)
    except ValueError:
        raise ValueError(f"{name} is {text[:40]!r}; it must be finite.") from None
    return value
