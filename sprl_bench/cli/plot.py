"""The command that draws pictures of runs."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from sprl_bench.cli.found_runs import find_runs, warn
from sprl_bench.cli.options import Agents, AllowMissing, Kind, Picture, Runs, Suites, Tasks, Width, check_choice

if TYPE_CHECKING:  # loaded when the command needs it
    from sprl_bench.records import RunRecord


def plot(
    runs: Runs,
    output: Picture,
    suite: Suites = None,
    task: Tasks = None,
    agent: Agents = None,
    kind: Kind = "curves",
    metric: Annotated[
        list[str] | None,
        typer.Option(help="What agents log, such as success or entropy, instead; may be given several times."),
    ] = None,
    axis: Annotated[
        str | None,
        typer.Option(help="Draw the AUC against this hyperparameter, or argument of the environment, instead."),
    ] = None,
    width: Width = None,
    allow_missing: AllowMissing = False,
) -> None:
    """Draw each agent's learning curve, one panel a task."""
    from sprl_bench import plots
    from sprl_bench.records import find_metrics
    from sprl_bench.tables import select_results

    check_choice("kind", kind, ("curves", *plots.KINDS))
    _check_one_picture(kind, metric, axis)
    if metric:
        plots.plot_metrics(find_metrics(runs), output, metric, tasks=task or None, agents=agent or None, width=width)
        typer.echo(f"Wrote {output}.", err=True)
        return
    found = find_runs(runs).of(suite or None)
    if allow_missing:
        warn(one.error for one in found.broken)
    else:
        found.refuse_broken()
    chosen = {"tasks": task or None, "agents": agent or None}
    if axis:
        plots.plot_axis(select_results(found.records, **chosen), output, axis, width=width)
    else:
        planned = {"planned": found.planned, "allow_missing": allow_missing}
        _plot_scores(found.records, output, kind, width, **chosen, **planned)
    typer.echo(f"Wrote {output}.", err=True)


def _check_one_picture(kind: str, metric: list[str] | None, axis: str | None) -> None:
    if metric and axis:
        raise ValueError(f"axis is {axis!r}; it must be left out where --metric is given.")
    if kind != "curves" and (metric or axis):
        raise ValueError(f"kind is {kind!r}; it must be left out where --metric or --axis is given.")


def _plot_scores(records: Sequence[RunRecord], output: Path, kind: str, width: str | None, **chosen: Any) -> None:
    """Draw learning curves, or one panel a suite."""
    from sprl_bench import plots

    if kind == "curves":
        plots.plot(records, output, width=width, **chosen)
    else:
        labels = plots.suite_labels(record.spec for record in records)
        plots.plot_suites(plots.suite_matrices(records, **chosen), output, kind, width=width, labels=labels)
