"""The command that draws pictures of runs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from sprl_bench.cli.options import Agents, AllowMissing, Picture, Runs, Tasks, check_choice, planned_runs


def plot(
    runs: Runs,
    output: Picture,
    task: Tasks = None,
    agent: Agents = None,
    kind: Annotated[
        str, typer.Option(help="curves, profiles (performance profiles), or improvement (its probability).")
    ] = "curves",
    metric: Annotated[
        list[str] | None,
        typer.Option(help="What agents log, such as success or entropy, instead; may be given several times."),
    ] = None,
    axis: Annotated[
        str | None,
        typer.Option(help="Draw the AUC against this hyperparameter, or argument of the environment, instead."),
    ] = None,
    width: Annotated[
        str | None, typer.Option(help="one-column or two-column, of a paper; by default what the panels need.")
    ] = None,
    allow_missing: AllowMissing = False,
) -> None:
    """Draw each agent's learning curve, one panel a task."""
    from sprl_bench import plots
    from sprl_bench.records import find_metrics, find_records
    from sprl_bench.tables import select_results

    check_choice("kind", kind, ("curves", *plots.KINDS))
    _check_one_picture(kind, metric, axis)
    if metric:
        plots.plot_metrics(find_metrics(runs), output, metric, tasks=task or None, agents=agent or None, width=width)
    elif axis:
        results = select_results(find_records(runs), tasks=task or None, agents=agent or None)
        plots.plot_axis(results, output, axis, width=width)
    else:
        chosen = {"tasks": task or None, "agents": agent or None, "planned": planned_runs(runs)}
        _plot_scores(runs, output, kind, width, allow_missing=allow_missing, **chosen)
    typer.echo(f"Wrote {output}.", err=True)


def _check_one_picture(kind: str, metric: list[str] | None, axis: str | None) -> None:
    if metric and axis:
        raise ValueError(f"axis is {axis!r}; it must be left out where --metric is given.")
    if kind != "curves" and (metric or axis):
        raise ValueError(f"kind is {kind!r}; it must be left out where --metric or --axis is given.")


def _plot_scores(runs: Path, output: Path, kind: str, width: str | None, **chosen: Any) -> None:
    """Draw learning curves, or one panel a suite."""
    from sprl_bench import plots
    from sprl_bench.records import find_records

    if kind == "curves":
        plots.plot(find_records(runs), output, width=width, **chosen)
    else:
        plots.plot_suites(plots.suite_matrices(find_records(runs), **chosen), output, kind, width=width)
