"""The command that draws pictures of runs."""

from __future__ import annotations

from typing import Annotated

import typer

from sprl_bench.cli.found_runs import find_runs, warn
from sprl_bench.cli.options import Agents, AllowMissing, Picture, Runs, Suites, Tasks


def plot(
    runs: Runs,
    output: Picture,
    suite: Suites = None,
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
    from sprl_bench.records import find_metrics
    from sprl_bench.tables import select_results

    if metric and axis:
        raise ValueError(f"axis is {axis!r}; it must be left out where --metric is given.")
    if metric:
        plots.plot_metrics(find_metrics(runs), output, metric, tasks=task or None, agents=agent or None)
        typer.echo(f"Wrote {output}.", err=True)
        return
    found = find_runs(runs).of(suite or None)
    if allow_missing:
        warn(one.error for one in found.broken)
    else:
        found.refuse_broken()
    if axis:
        plots.plot_axis(select_results(found.records, tasks=task or None, agents=agent or None), output, axis)
    else:
        plots.plot(
            found.records,
            output,
            tasks=task or None,
            agents=agent or None,
            planned=found.planned,
            allow_missing=allow_missing,
        )
    typer.echo(f"Wrote {output}.", err=True)
