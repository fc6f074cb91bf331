"""The command that draws learning curves."""

from __future__ import annotations

import typer

from sprl_bench.cli.options import Agents, AllowMissing, Picture, Runs, Tasks, planned_runs


def plot(
    runs: Runs, output: Picture, task: Tasks = None, agent: Agents = None, allow_missing: AllowMissing = False
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
