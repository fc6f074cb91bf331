"""What a sweep is going to do, written down before its first run."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Final, Literal, Self

from pydantic import Field, model_validator

from sprl_bench.records import Data, read, write
from sprl_bench.records.types import Count, Json, Line, Name

FILE: Final = "sweep.json"
RULE: Final = (
    "The highest mean AUC: the mean over the tasks of the mean over the seeds. Of equal ones, the one that is declared "
    "first."
)


class ChangedSweepError(ValueError):
    """The folder holds a sweep that was declared otherwise."""


class Setting(Data):
    """One setting of an agent: the name that it runs under, and its value of each hyperparameter that is swept."""

    name: Line
    values: dict[Line, Json]


class Declaration(Data):
    """A sweep: which settings, on what, by which seeds, and how one of them is chosen."""

    schema_version: Literal[1] = 1
    suite: Name
    suite_version: Count
    tasks: Annotated[dict[Name, Annotated[int, Field(gt=0)]], Field(min_length=1)]  # with their budgets
    seeds: Annotated[tuple[Count, ...], Field(min_length=1, strict=False)]
    settings: dict[Line, Annotated[tuple[Setting, ...], Field(min_length=1, strict=False)]] = Field(
        description="By the agent that they are settings of."
    )
    rule: Line = RULE

    @model_validator(mode="after")
    def _names_are_distinct(self) -> Self:
        names = self.names
        if len(set(names)) < len(names):
            raise ValueError("settings holds a name twice; it must hold each once")
        return self

    @property
    def names(self) -> list[str]:
        """The names of all settings."""
        return [setting.name for settings in self.settings.values() for setting in settings]

    @property
    def num_runs(self) -> int:
        """How many runs there are."""
        return len(self.names) * len(self.tasks) * len(self.seeds)

    @property
    def env_steps(self) -> int:
        """How many env steps all runs take."""
        return len(self.names) * len(self.seeds) * sum(self.tasks.values())


def read_declaration(folder: Path) -> Declaration:
    """Read the declaration of the sweep in this folder.

    Raises:
        FileNotFoundError: There is none.
        InvalidFileError: It is broken.
    """
    if not (folder / FILE).exists():
        raise FileNotFoundError(f"{folder} holds no sweep; it must have the file {FILE}.")
    return read(folder / FILE, Declaration)


def declare(declaration: Declaration, folder: Path) -> None:
    """Write a declaration into its folder, or check that the same one is there.

    Raises:
        ChangedSweepError: Another one is there; the message names the first difference.
    """
    if not (folder / FILE).exists():
        folder.mkdir(parents=True, exist_ok=True)
        write(folder / FILE, declaration)
        return
    there, now = (one.model_dump(mode="json") for one in (read_declaration(folder), declaration))
    for name in now:
        if there[name] != now[name]:
            before, after = _told(there[name], now[name])
            raise ChangedSweepError(
                f"{folder} holds another sweep: {name} is {before} there and {after} now. Use "
                "another --out, or remove that folder."
            )


def _told(there: Any, now: Any) -> tuple[str, str]:
    """Return both values as short texts that differ: lists of the same keys by their lengths."""
    before, after = _short(there), _short(now)
    if before != after or not isinstance(there, Mapping):
        return before, after
    key = next(key for key in there if there[key] != now[key])
    if len(there[key]) != len(now[key]):
        return f"{len(there[key])} of {key}", f"{len(now[key])} of {key}"
    return f"{key} with some values", f"{key} with others"


def _short(value: object) -> str:
    text = ", ".join(value) if isinstance(value, Mapping) else str(value)
    return text if len(text) <= 60 else f"{text[:60]}..."
