"""Commands that turn records into tables and pictures."""

# ruff: noqa: PLC0415 - a command loads what it needs when it is called, so that help is quick

from __future__ import annotations

import shutil
import sys
from collections.abc import Collection, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Annotated, Final

import typer

from sprl_bench.suggestions import unknown

if TYPE_CHECKING:  # loaded when a command needs them
    from sprl_bench.records import RunRecord, RunSpec

__all__ = [
    "Agents",
    "AllowMissing",
    "Format",
    "Output",
    "Picture",
    "Tasks",
    "check_choice",
    "choose_format",
    "deliver",
    "planned_runs",
    "plot",
    "print_tables",
    "table",
    "terminal_width",
]

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


def table(
    runs: Runs,
    form: Format = None,
    output: Output = None,
    task: Tasks = None,
    agent: Agents = None,
    allow_missing: AllowMissing = False,
) -> None:
    """Show each agent's mean AUC with its interval, one table a suite."""
    from sprl_bench.records import find_records
    from sprl_bench.tables import FORMATS, render, tabulate

    form = choose_format(form, output, FORMATS)
    made = tabulate(
        find_records(runs),
        tasks=task or None,
        agents=agent or None,
        planned=planned_runs(runs),
        allow_missing=allow_missing,
    )
    deliver(render(made, form, width=terminal_width(output)), output)


def plot(
    runs: Runs,
    output: Picture,
    task: Tasks = None,
    agent: Agents = None,
    allow_missing: AllowMissing = False,
) -> None:
    """Draw each agent's learning curve, one panel a task."""
    from sprl_bench import plots
    from sprl_bench.records import find_records

    plots.plot(
        find_records(runs),
        output,
        tasks=task or None,
        agents=agent or None,
        planned=planned_runs(runs),
        allow_missing=allow_missing,
    )
    typer.echo(f"Wrote {output}.", err=True)


def print_tables(records: Sequence[RunRecord], planned: Sequence[RunSpec]) -> None:
    """Print the tables of the planned runs' records; whatever is missing or keeps them apart is said."""
    from sprl_bench.tables import IncomparableError, render, tabulate

    tasks = sorted({spec.task.name for spec in planned})
    try:
        made = tabulate(records, tasks=tasks, planned=planned, allow_missing=True)
    except IncomparableError as error:
        typer.echo(f"No table: {error}", err=True)
        return
    deliver(render(made, "rich", width=terminal_width(None)), None)


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
