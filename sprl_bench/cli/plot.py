"""The command that draws pictures of runs."""

from __future__ import annotations

from typing import Annotated

import typer

from sprl_bench.cli.options import Agents, AllowMissing, Picture, Runs, Tasks, planned_runs


def plot(
    runs: Runs,
    output: Picture,
    task: Tasks = None,
    agent: Agents = None,
    metric: Annotated[
        list[str] | None,
        typer.Option(help="What agents log, such as success or entropy, instead; may be given several times."),
    ] = None,
    axis: Annotated[
        str | None,
        typer.Option(help="Draw the AUC against this hyperparameter, or argument of the environment, instead."),
    ] = None,
    allow_missing: AllowMissing = False,
) -> None:
    """Draw each agent's learning curve, one panel a task."""
    from sprl_bench import plots
    from sprl_bench.records import find_metrics, find_records
    from sprl_bench.tables import select_results

    if metric and axis:
        raise ValueError(f"axis is {axis!r}; it must be left out where --metric is given.")
    if metric:
        plots.plot_metrics(find_metrics(runs), output, metric, tasks=task or None, agents=agent or None)
    elif axis:
        plots.plot_axis(select_results(find_records(runs), tasks=task or None, agents=agent or None), output, axis)
    else:
        plots.plot(
            find_records(runs),
            output,
            tasks=task or None,
            agents=agent or None,
            planned=planned_runs(runs),
            allow_missing=allow_missing,
        )
    typer.echo(f"Wrote {output}.", err=True)
