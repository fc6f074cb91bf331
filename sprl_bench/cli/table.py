"""The command that prints tables."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated

import typer

from sprl_bench.cli import options

if TYPE_CHECKING:  # loaded when a command needs them
    from sprl_bench.records import RunRecord, RunSpec


def table(
    runs: options.Runs,
    form: options.Format = None,
    output: options.Output = None,
    task: options.Tasks = None,
    agent: options.Agents = None,
    columns: Annotated[
        str | None,
        typer.Option(help="Only these, as in 'Seeds,Mean AUC,IQM'; a paper's column has room for three or four."),
    ] = None,
    allow_missing: options.AllowMissing = False,
) -> None:
    """Show each agent's mean AUC with its interval, one table a suite."""
    from sprl_bench.records import find_records
    from sprl_bench.tables import FORMATS, render, tabulate

    form = options.choose_format(form, output, FORMATS)
    made = tabulate(
        find_records(runs),
        tasks=task or None,
        agents=agent or None,
        planned=options.planned_runs(runs),
        allow_missing=allow_missing,
    )
    chosen = options.split_names(columns, "columns") if columns is not None else None
    options.deliver(render(made, form, width=options.terminal_width(output), columns=chosen), output)


def print_tables(records: Sequence[RunRecord], planned: Sequence[RunSpec]) -> None:
    """Print the tables of the planned runs' records, with notes on missing runs, or why there is no table."""
    from sprl_bench.tables import IncomparableError, render, tabulate

    tasks = sorted({spec.task.name for spec in planned})
    try:
        made = tabulate(records, tasks=tasks, planned=planned, allow_missing=True)
    except IncomparableError as error:
        typer.echo(f"No table: {error}", err=True)
        return
    options.deliver(render(made, "rich", width=options.terminal_width(None)), None)
