"""What several commands share: their options, the values these take, and where output goes."""

# ruff: noqa: PLC0415 - a command loads what it needs when it is called, so that help is quick

from __future__ import annotations

import json
import shutil
import sys
from collections.abc import Collection, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Annotated, Final

import typer

from sprl_bench.suggestions import unknown

if TYPE_CHECKING:  # loaded when a command needs it
    from sprl_bench.records import RunSpec

SUFFIXES: Final = MappingProxyType({".csv": "csv", ".json": "json", ".md": "md", ".tex": "latex"})

Runs = Annotated[Path, typer.Argument(help="A folder with runs.")]
Tasks = Annotated[list[str] | None, typer.Option("--task", help="Only this task; may be given several times.")]
Agents = Annotated[list[str] | None, typer.Option("--agent", help="Only this agent; may be given several times.")]
AllowMissing = Annotated[bool, typer.Option("--allow-missing", help="Show what is there, and mark what is missing.")]
Format = Annotated[
    str | None, typer.Option("--format", help="rich, md, csv, latex or json; by default as the file's name ends.")
]
Output = Annotated[Path | None, typer.Option("-o", "--output", help="A file to write to.")]
Picture = Annotated[Path, typer.Option("-o", "--output", help="A .png, .svg or .pdf file.")]


def require_command(context: typer.Context) -> None:
    """Show the help where a command is missing, and say by the exit status that it is."""
    if context.invoked_subcommand is None:
        typer.echo(context.get_help())
        raise typer.Exit(2)


def planned_runs(runs: Path) -> list[RunSpec]:
    """Return every run that was begun or asked for below this folder."""
    from sprl_bench.suite import survey

    return [state.spec for state in survey(runs)]


def choose_format(form: str | None, output: Path | None, allowed: Collection[str]) -> str:
    """Return the format asked for, or that which the file's name ends in.

    Raises:
        ValueError: It is not allowed; the message lists what is.
    """
    chosen = form or SUFFIXES.get(output.suffix.lower() if output else "", "rich")
    check_choice("format", chosen, allowed)
    return chosen


def check_choice(name: str, value: str, allowed: Collection[str]) -> None:
    """Refuse a value that is not allowed before any work is done.

    Raises:
        ValueError: It is not; the message lists what is.
    """
    if value not in allowed:
        raise ValueError(unknown(name, value, allowed))


def deliver(text: str, output: Path | None) -> None:
    """Print `text`, or write it to a file and say so."""
    if output is None:
        sys.stdout.write(text)
        return
    from sprl_bench.records import write_bytes

    write_bytes(output, text.encode())
    typer.echo(f"Wrote {output}.", err=True)


def terminal_width(output: Path | None) -> int | None:
    """Return the columns of the terminal that text is shown in, or None where it is not."""
    return shutil.get_terminal_size().columns if output is None and sys.stdout.isatty() else None


def find_modules_here() -> None:
    """Let a module that the user names be found in the current folder, as `python -m` would; workers inherit this."""
    here = str(Path.cwd())
    if here not in sys.path:
        sys.path.insert(0, here)


def split_names(text: str, name: str) -> list[str]:
    """Return the names in "a,b,c".

    Raises:
        ValueError: One of them is empty.
    """
    words = [word.strip() for word in text.split(",")]
    if not all(words):
        raise ValueError(f"{name} is {text!r}; give names with commas between.")
    return words


def parse_seeds(text: str) -> list[int]:
    """Return the seeds that "5" (0 to 4) or "0,3,7" stand for.

    Raises:
        ValueError: It is neither a positive number nor a list of seeds.
    """
    words = [word.strip() for word in text.split(",") if word.strip()]
    if not words or not all(word.isascii() and word.isdecimal() and len(word) < 16 for word in words):
        raise ValueError(f"seeds is {text!r}; give how many, as in 5, or which, as in 0,3,7.")
    numbers = [int(word) for word in words]
    if "," in text:
        return numbers
    if not 0 < numbers[0] <= 10_000:
        raise ValueError(f"seeds is {text!r}; from 1 to 10000 are allowed (a single seed is written as {text},).")
    return list(range(numbers[0]))


def parse_settings(settings: Sequence[str], option: str = "--set") -> dict[str, object]:
    """Return what "key=value" stand for, as given by a command's `option`: each value JSON if it is, else a string.

    Raises:
        ValueError: There is no "=", a key is there twice, or a value is a number that is not finite.
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
        raise ValueError(f"{name}: {text[:40]!r} is too long or too deep.") from None
    try:
        json.dumps(value, allow_nan=False)
    except ValueError:
        raise ValueError(f"{name}: {text[:40]!r} is not finite.") from None
    return value
