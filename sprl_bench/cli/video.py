"""The command that makes videos."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, cast

import typer

from sprl_bench.cli.options import find_modules_here
from sprl_bench.naming import parse_settings

if TYPE_CHECKING:  # loaded when a command needs them
    from sprl_bench.tasks import Argument
    from sprl_bench.video import Episode


def video(
    env_id: Annotated[str, typer.Argument(metavar="ID", help="The environment; see: sprl-bench list envs.")],
    output: Annotated[Path, typer.Option("-o", "--output", help="A .mp4 or .gif file.")],
    argument: Annotated[
        list[str] | None,
        typer.Option("--arg", metavar="KEY=VALUE", help="Of the environment; may be given several times."),
    ] = None,
    policy: Annotated[
        str | None,
        typer.Option(help="random (the default), still, solver on grids, or your own as package.module:function."),
    ] = None,
    run: Annotated[
        Path | None, typer.Option("--run", help="A run, or a folder with runs: its trained agent acts.")
    ] = None,
    agent: Annotated[
        str | None,
        typer.Option(
            help="The agent, if the folder has runs of several; your own must be named, as package.module:factory."
        ),
    ] = None,
    episodes: Annotated[int, typer.Option(min=1, help="How many, one after the other.")] = 1,
    seed: Annotated[int, typer.Option(min=0, help="Of the environment and of the random policy.")] = 0,
) -> None:
    """Film episodes of an environment under a policy or a trained agent."""
    from sprl_bench.video import record_video

    if ":" in (policy or "") or ":" in (agent or ""):
        find_modules_here()
    filmed = record_video(
        env_id,
        output,
        policy=_choose_actor(env_id, policy, run, agent),
        agent=agent,
        arguments=cast("Mapping[str, Argument]", parse_settings(argument or (), option="--arg")),
        episodes=episodes,
        seed=seed,
    )
    for line in _describe(filmed):
        typer.echo(line)
    typer.echo(f"Wrote {output}.", err=True)


def _choose_actor(env_id: str, policy: str | None, run: Path | None, agent: str | None) -> str:
    """Return the name of the policy, or the folder of the run."""
    from sprl_bench.policies import find_run

    if run is None:
        if agent is not None:
            raise ValueError(f"agent is {agent!r}; it must come with --run and the folder of its run.")
        return policy or "random"
    if policy is not None:
        raise ValueError(f"policy is {policy!r}; it must be left out if --run is given.")
    return str(find_run(run, env_id.rpartition(":")[2], agent))


def _describe(episodes: Iterable[Episode]) -> list[str]:
    return [
        f"episode {number}: {episode.steps} steps, return {episode.total_reward:g}, "
        f"{'success' if episode.is_success else 'no success'}"
        for number, episode in enumerate(episodes, start=1)
    ]
