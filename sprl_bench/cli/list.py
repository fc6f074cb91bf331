"""The commands that list environments, tasks, suites and agents."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import typer

from sprl_bench.cli.options import require_command

if TYPE_CHECKING:  # loaded when a command needs it
    from sprl_bench.tasks import Task

app = typer.Typer(
    help="List environments, tasks, suites or agents.", callback=require_command, invoke_without_command=True
)


@app.command("envs")
def envs() -> None:
    """List the Gymnasium ids."""
    from sprl_bench.envs import IDS

    for name in IDS:
        typer.echo(name)


@app.command("tasks")
def tasks() -> None:
    """List the tasks of every suite: budgets in environment steps, and the most sub-environments on a leaderboard."""
    from sprl_bench.tasks import SUITES

    rows = [
        (suite.name, task.name, task.env_id, f"{task.budget:,}", str(task.max_num_envs or ""), _arguments(task))
        for suite in SUITES.values()
        for task in suite.tasks
    ]
    _columns(("suite", "task", "environment", "budget", "max_num_envs", "arguments"), rows)


@app.command("suites")
def suites() -> None:
    """List the suites with their versions and tasks."""
    from sprl_bench.tasks import SUITES

    rows = [(suite.name, str(suite.version), ", ".join(task.name for task in suite.tasks)) for suite in SUITES.values()]
    _columns(("suite", "version", "tasks"), rows)


@app.command("agents")
def agents() -> None:
    """List the installed agents; presets are named as in sprl@tuned, variants as in sprl+k=5.

    Name your own as package.module:factory.
    """
    from sprl_bench.agents import agent_names

    for name in agent_names():
        typer.echo(name)


def _arguments(task: Task) -> str:
    return ", ".join(f"{name}={value}" for name, value in task.arguments.items())


def _columns(header: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    widths = [max(len(row[column]) for row in (header, *rows)) for column in range(len(header))]
    for row in (header, *rows):
        typer.echo("  ".join(text.ljust(width) for text, width in zip(row, widths, strict=True)).rstrip())
