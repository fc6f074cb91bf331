"""The command that says whether an agent learns as the published one does."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from sprl_bench.cli import options

if TYPE_CHECKING:  # loaded when the command needs them
    from sprl_bench.known_answers import Verdict
    from sprl_bench.records import RunSpec


def check_agent(
    agent: Annotated[str, typer.Argument(help="An installed agent, or your own as package.module:factory.")],
    like: Annotated[str, typer.Option(help="The published agent that yours should learn like, as ppo.")] = "",
    task: options.Tasks = None,
    out: Annotated[Path | None, typer.Option(help="A folder to keep the runs in; else they are removed.")] = None,
) -> int:
    """Train an agent for about two minutes, and say whether its learning curves lie in the published bands."""
    from sprl_bench.known_answers import check_agent as check

    if ":" in agent:
        options.find_modules_here()
    verdicts = []
    for verdict in check(agent, like=like, tasks=task or None, out=out, progress=_announce):
        verdicts.append(verdict)
        _show(verdict)
    passed = sum(one.passed for one in verdicts)
    typer.echo(f"{agent} is in the band of {like or agent} on {passed} of {len(verdicts)} tasks.")
    return 0 if passed == len(verdicts) else 1


def _announce(spec: RunSpec) -> None:
    typer.echo(f"Training on {spec.task.name}, seed {spec.seed}: {spec.task.budget:,} env steps.", err=True)


def _show(verdict: Verdict) -> None:
    """Print a task's verdict, with the mean return and the band of each fifth of the budget, and of all of it."""
    known = f" (chance {verdict.known[0]:.2f}, best {verdict.known[1]:.2f})" if verdict.known else ""
    typer.echo(f"{verdict.task}{known}: {verdict.sentence}.")
    band = verdict.band
    texts = [f"{low:.2f} to {high:.2f}" for low, high in zip(band.low, band.high, strict=True)]
    typer.echo(f"  mean return {'  '.join(f'{value:>12.2f}' for value in verdict.figures)}")
    typer.echo(f"  its band    {'  '.join(f'{text:>12}' for text in texts)}")
