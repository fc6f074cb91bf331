"""The command that prints tables."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Annotated, Final

import typer

from sprl_bench.cli import options
from sprl_bench.cli.found_runs import REMEDY, FoundRuns, describe_broken, find_runs, warn

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
    suite: options.Suites = None,
    task: options.Tasks = None,
    agent: options.Agents = None,
    columns: options.Columns = None,
    allow_missing: options.AllowMissing = False,
    statistic: Statistic = "auc",
) -> int:
    """Show each agent's mean AUC, or another statistic, with its interval; the exit status is 1 if a suite has none."""
    from sprl_bench.tables import FORMATS, MissingRunsError, Result, render, tabulate_finished
    from sprl_bench.tables.statistics import STATISTICS, tabulate_statistic
    from sprl_bench.tables.statistics_text import render_statistic

    options.check_choice("statistic", statistic, ("auc", *STATISTICS))
    form = options.choose_format(form, output, FORMATS)
    found = find_runs(runs).of(suite or None)
    made, lacking = tabulate_finished(
        found.records,
        tasks=task or None,
        agents=agent or None,
        planned=found.planned,
        allow_missing=allow_missing,
        statuses=found.statuses,
        broken=_faults(found, allow_missing=allow_missing),
        unreadable=found.unreadable,
    )
    known = {spec.suite for spec in found.planned}
    elsewhere = [one.error for one in found.broken if one.suite not in known]
    if not made:
        raise MissingRunsError(" ".join([*lacking, *elsewhere]) or "There is no finished run to make a table of.")
    width = options.terminal_width(output)
    if columns is not None and statistic != "auc":
        raise ValueError(f"columns is {columns!r}; it must be left out where --statistic is {statistic!r}.")
    if statistic == "auc":
        chosen = options.split_names(columns, "columns") if columns is not None else None
        text = render(made, form, width=width, columns=chosen)
    else:
        results = [Result.of(record) for record in found.records if record.status == "complete"]
        text = render_statistic(tabulate_statistic(made, results, statistic), form, width=width)
    options.deliver(text, output)
    warn([*lacking, *elsewhere])
    return 1 if lacking or (elsewhere and not allow_missing) else 0


def _faults(found: FoundRuns, *, allow_missing: bool) -> dict[str, str]:
    """Return why runs cannot be read, by suite."""
    return {
        suite: describe_broken(own) + f" {REMEDY}" * (not allow_missing)
        for suite in {one.suite for one in found.broken if one.suite}
        if (own := [one for one in found.broken if one.suite == suite])
    }


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
