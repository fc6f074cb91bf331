"""The command that prints tables."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Final

import typer

from sprl_bench.cli import options

if TYPE_CHECKING:  # loaded when a command needs them
    from sprl_bench.records import RunRecord, RunSpec


NONE: Final[Mapping[Path, str]] = MappingProxyType({})


def table(
    runs: options.Runs,
    form: options.Format = None,
    output: options.Output = None,
    task: options.Tasks = None,
    agent: options.Agents = None,
    allow_missing: options.AllowMissing = False,
) -> None:
    """Show each agent's mean AUC with its interval, one table a suite."""
    from sprl_bench.records import find_records
    from sprl_bench.tables import FORMATS, render, tabulate

    form = options.choose_format(form, output, FORMATS)
    planned, statuses = options.planned_and_statuses(runs)
    made = tabulate(
        find_records(runs),
        tasks=task or None,
        agents=agent or None,
        planned=planned,
        allow_missing=allow_missing,
        drop_incomparable=allow_missing,
        statuses=statuses,
    )
    options.deliver(render(made, form, width=options.terminal_width(output)), output)


def print_tables(records: Sequence[RunRecord], planned: Sequence[RunSpec], statuses: Mapping[Path, str] = NONE) -> None:
    """Print the tables of the planned runs' records, with notes on missing runs, or why there is no table."""
    from sprl_bench.tables import IncomparableError, render, tabulate

    tasks = sorted({spec.task.name for spec in planned})
    try:
        made = tabulate(records, tasks=tasks, planned=planned, allow_missing=True, statuses=statuses)
    except IncomparableError as error:
        typer.echo(f"No table: {error}", err=True)
        return
    options.deliver(render(made, "rich", width=options.terminal_width(None)), None)
