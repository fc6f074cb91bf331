"""Shared by several commands: options, their values, and the output."""

from __future__ import annotations

import shlex
import shutil
import sys
from collections.abc import Collection, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Annotated, Final

import typer

from sprl_bench.cli.streams import legible
from sprl_bench.suggestions import unknown

if TYPE_CHECKING:  # loaded when a command needs it
    from sprl_bench.records import RunSpec

PLAIN: Final = ("", ".txt")
SUFFIXES: Final = MappingProxyType({".csv": "csv", ".json": "json", ".md": "md", ".tex": "latex"})

Runs = Annotated[Path, typer.Argument(help="A folder with runs.")]
Tasks = Annotated[list[str] | None, typer.Option("--task", help="Only this task; may be given several times.")]
Suites = Annotated[list[str] | None, typer.Option("--suite", help="Only this suite; may be given several times.")]
Agents = Annotated[list[str] | None, typer.Option("--agent", help="Only this agent; may be given several times.")]
AllowMissing = Annotated[
    bool, typer.Option("--allow-missing", help="Show the finished runs, and mark the missing ones.")
]
Format = Annotated[
    str | None, typer.Option("--format", help="rich, md, csv, latex or json; by default by the file's suffix.")
]
KeepActions = Annotated[
    bool, typer.Option("--keep-actions", help="Keep every action, so that sprl-bench verify can repeat the runs.")
]
Output = Annotated[Path | None, typer.Option("-o", "--output", help="A file to write to.")]
Columns = Annotated[
    str | None,
    typer.Option(help="Only these, as in 'Seeds,Mean AUC,IQM'; a paper's column has room for three or four."),
]
Kind = Annotated[str, typer.Option(help="curves, profiles (performance profiles), or improvement (its probability).")]
Width = Annotated[
    str | None, typer.Option(help="one-column or two-column, of a paper; by default what the panels need.")
]
Picture = Annotated[Path, typer.Option("-o", "--output", help="A .png, .svg or .pdf file.")]


def require_command(context: typer.Context) -> None:
    """Show the help if the command is missing, with the exit status of a wrong command."""
    if context.invoked_subcommand is None:
        typer.echo(context.get_help())
        raise typer.Exit(2)


def choose_format(form: str | None, output: Path | None, allowed: Collection[str]) -> str:
    """Return `form` or, by default, the format of the file's suffix.

    Raises:
        ValueError: It is not allowed; the message lists the allowed formats.
    """
    chosen = form or _format_of(output, allowed)
    check_choice("format", chosen, allowed)
    return chosen


def _format_of(output: Path | None, allowed: Collection[str]) -> str:
    """Return the format of a file's suffix; that of a terminal without a file, or for one that names none."""
    suffix = output.suffix.lower() if output else ""
    if suffix in PLAIN:
        return "rich"
    if SUFFIXES.get(suffix) not in allowed:
        known = ", ".join(sorted([*(one for one, form in SUFFIXES.items() if form in allowed), ".txt"]))
        raise ValueError(f"output is {str(output)!r}; it must end in {known}, or --format must be given.")
    return SUFFIXES[suffix]


def check_choice(name: str, value: str, allowed: Collection[str]) -> None:
    """Refuse a value that is not allowed.

    Raises:
        ValueError: It is not allowed; the message lists the allowed values.
    """
    if value not in allowed:
        raise ValueError(unknown(name, value, allowed))


def deliver(text: str, output: Path | None) -> None:
    """Print `text`, or write it to a file and say so."""
    if output is None:
        sys.stdout.write(legible(text, sys.stdout.encoding))
        return
    from sprl_bench.records import write_bytes

    write_bytes(output, text.encode())
    typer.echo(f"Wrote {output}.", err=True)


def terminal_width(output: Path | None) -> int | None:
    """Return the columns of the terminal, or None if the text does not go to one."""
    return shutil.get_terminal_size().columns if output is None and sys.stdout.isatty() else None


def note_short_budgets(specs: Sequence[RunSpec]) -> None:
    """Say which runs end before their agents' networks are in use."""
    from sprl_bench.suite import too_short

    for sentence in too_short(specs):
        typer.echo(f"Note: {sentence}", err=True)


def find_modules_here() -> None:
    """Find the user's modules in the current folder, as `python -m` would; workers inherit this."""
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
        raise ValueError(f"{name} is {text!r}; it must be names with commas between.")
    return words


def parse_seeds(text: str) -> list[int]:
    """Return the seeds of "5" (0 to 4) or "0,3,7".

    Raises:
        ValueError: It is neither a positive number nor a list of seeds.
    """
    from sprl_bench.records.types import LIMIT

    words = [word.strip() for word in text.split(",") if word.strip()]
    if not words or not all(word.isascii() and word.isdecimal() and len(word) < 20 for word in words):
        raise ValueError(f"seeds is {text!r}; it must be how many, as in 5, or which, as in 0,3,7.")
    numbers = [int(word) for word in words]
    if max(numbers) >= LIMIT:
        raise ValueError(f"seeds holds {max(numbers)}; it must hold numbers below 2^53.")
    if "," in text:
        return numbers
    if not 0 < numbers[0] <= 10_000:
        raise ValueError(f"seeds is {text!r}; it must be from 1 to 10000 (a single seed is written as {text},).")
    return list(range(numbers[0]))


def program_name() -> str:
    """Return how the reader starts this program: by its name or, in an environment that is not active, by its path."""
    started = Path(sys.argv[0])
    if shutil.which("sprl-bench") or not started.name.startswith("sprl-bench"):
        return "sprl-bench"
    return shlex.quote(str(started))
