"""The command that says how many more seeds would decide."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from sprl_bench.cli import options
from sprl_bench.cli.leaderboard import BOARD, ComparisonFormat, Seeds, runs_of


def power(
    runs: options.Runs,
    against: Annotated[Path, typer.Option(help=BOARD)],
    agent: Annotated[str | None, typer.Option(help="The agent; by default all.")] = None,
    task: options.Tasks = None,
    seeds: Seeds = None,
    looks: Annotated[
        int, typer.Option(min=1, max=200, help="After how many seeds you may look; choose it before the first.")
    ] = 30,
    form: ComparisonFormat = None,
    output: options.Output = None,
) -> None:
    """Say how many more seeds decide, at 5 % with 80 % power, whether runs differ from entries."""
    from sprl_bench import leaderboard

    form = options.choose_format(form, output, leaderboard.COMPARISON_FORMATS)
    entries = leaderboard.find_board(against)
    records, planned = runs_of(runs, seeds, suites=[entry.suite for entry in entries], agent=agent)
    plans = leaderboard.plan_seeds(records, entries, agent=agent, tasks=task or None, planned=planned, looks=looks)
    options.deliver(leaderboard.render_plans(plans, form, width=options.terminal_width(output)), output)
