"""The command that prints tables."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Annotated, Final

import typer

from sprl_bench.cli import options

if TYPE_CHECKING:  # loaded when a command needs them
    from sprl_bench.records import RunRecord, RunSpec


Statistic = Annotated[
    str,
    typer.Option(
        help="auc; solved: the share of seeds that solve the task; first-goal: env steps to the first success; oracle: "
        "AUC as a share of the solver's."
    ),
]
NONE: Final[Mapping[Path, str]] = MappingProxyType({})


def table(
    runs: options.Runs,
    form: options.Format = None,
    output: options.Output = None,
    task: options.Tasks = None,
    agent: options.Agents = None,
    allow_missing: options.AllowMissing = False,
    statistic: Statistic = "auc",
) -> None:
    """Show each agent's mean AUC, or another statistic, with its interval, one table a suite."""
    from sprl_bench.records import find_records
    from sprl_bench.tables import FORMATS, Result, render, tabulate
    from sprl_bench.tables.statistics import STATISTICS, tabulate_statistic
    from sprl_bench.tables.statistics_text import render_statistic

    options.check_choice("statistic", statistic, ("auc", *STATISTICS))
    form = options.choose_format(form, output, FORMATS)
    planned, statuses = options.planned_and_statuses(runs)
    records = find_records(runs)
    made = tabulate(
        records,
        tasks=task or None,
        agents=agent or None,
        planned=planned,
        allow_missing=allow_missing,
        drop_incomparable=allow_missing,
        statuses=statuses,
    )
    width = options.terminal_width(output)
    if statistic == "auc":
        options.deliver(render(made, form, width=width), output)
        return
    results = [Result.of(record) for record in records if record.status == "complete"]
    options.deliver(render_statistic(tabulate_statistic(made, results, statistic), form, width=width), output)


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
