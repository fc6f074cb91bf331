"""Commands around sweeps."""

from __future__ import annotations

from collections.abc import Sized
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from sprl_bench.cli.options import (
    KeepActions,
    Tasks,
    check_choice,
    find_modules_here,
    note_short_budgets,
    parse_seeds,
    split_names,
)

if TYPE_CHECKING:  # loaded when a command needs it
    from sprl_bench.sweeps import Declaration

app = typer.Typer(help="Try all settings of a range, and choose one.", invoke_without_command=True)

FIRST_SEED = 100  # of a sweep; entries use lower ones
Out = Annotated[Path, typer.Option(help="The folder of the sweep.")]


@app.callback()
def sweep(
    context: typer.Context,
    suite: Annotated[str, typer.Option(help="The suite; see: sprl-bench list suites.")] = "",
    agents: Annotated[str, typer.Option("--agents", "--agent", help="Agents, with commas between.")] = "",
    range_: Annotated[
        str, typer.Option("--range", help="What to try: table, the paper's; or a .toml or .json file.")
    ] = "table",
    seeds: Annotated[
        str, typer.Option(help=f"How many seeds, from {FIRST_SEED}; or the seeds themselves, as in 100,103.")
    ] = "3",
    budget_share: Annotated[float, typer.Option(help="The budgets, as a share of the tasks' own.")] = 0.5,
    samples: Annotated[int | None, typer.Option(min=1, help="So many settings an agent, drawn at random.")] = None,
    sampling_seed: Annotated[int, typer.Option(min=0, help="Decides which settings are drawn.")] = 0,
    task: Tasks = None,
    out: Out = Path("sweep"),
    workers: Annotated[int, typer.Option(min=0, help="How many runs at once; 0 for one a core.")] = 0,
    executor: Annotated[str, typer.Option(help="local, ray or slurm.")] = "local",
    device: Annotated[str, typer.Option(help="Where agents compute: auto, cpu, cuda or cuda:N.")] = "auto",
    keep_actions: KeepActions = False,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Say what would be run, and stop.")] = False,
) -> int:
    """Train every setting of a range; the same command again continues where it stopped."""
    if context.invoked_subcommand is not None:
        return 0
    from sprl_bench import sweeps
    from sprl_bench.executors import make_executor
    from sprl_bench.progress import make_observer
    from sprl_bench.suite import run_suite

    if not suite or not agents:
        raise ValueError(f"{'agents' if suite else 'suite'} is missing; a sweep needs both --suite and --agents.")
    names = split_names(agents, "agents")
    if any(":" in name for name in names):
        find_modules_here()
    declaration = _declaration(suite, names, range_, _seeds(seeds, suite), budget_share, samples, sampling_seed, task)
    specs = sweeps.specs_of(declaration, device)
    typer.echo(
        f"{_counted(declaration.names, 'setting')} on {_counted(declaration.tasks, 'task')} with "
        f"{_counted(declaration.seeds, 'seed')}: "
        f"{declaration.num_runs} runs, {declaration.env_steps:,} env steps.",
        err=True,
    )
    if dry_run:
        for name in declaration.names:
            typer.echo(name)
        note_short_budgets(specs)
        return 0
    works = make_executor(executor, workers)
    sweeps.declare(declaration, out)
    note_short_budgets(specs)
    outcomes = run_suite(specs, out, executor=works, observer=make_observer(), keep_actions=keep_actions)
    failed = sum(outcome.status == "failed" for outcome in outcomes)
    if failed:
        typer.echo(f"{failed} of {len(outcomes)} runs failed; the same command tries them again.", err=True)
    typer.echo(f"Next:    sprl-bench sweep report {out}")
    return 1 if failed else 0


def _counted(things: Sized, name: str) -> str:
    return f"{len(things)} {name}{'' if len(things) == 1 else 's'}"


def _declaration(
    suite: str,
    agents: list[str],
    range_: str,
    seeds: list[int],
    budget_share: float,
    samples: int | None,
    sampling_seed: int,
    tasks: list[str] | None,
) -> Declaration:
    from sprl_bench import sweeps
    from sprl_bench.tasks import find_suite

    if not 0 < budget_share <= 1:
        raise ValueError(f"budget_share is {budget_share}; it must be above 0 and at most 1.")
    if len(set(agents)) < len(agents):
        raise ValueError(f"agents is {agents}; it must name each agent once.")
    found = find_suite(suite)
    chosen = [found.task(name) for name in tasks] if tasks else list(found.tasks)
    domain = chosen[0].domain
    given = {agent: sweeps.table_ranges(agent, domain) for agent in agents} if range_ == "table" else None
    ranges = given or sweeps.read_ranges(Path(range_), agents)
    return sweeps.Declaration(
        suite=suite,
        suite_version=found.version,
        tasks={row.name: max(1, round(row.budget * budget_share)) for row in chosen},
        seeds=tuple(seeds),
        settings={
            agent: tuple(sweeps.settings_of(agent, domain, ranges[agent], samples, sampling_seed)) for agent in agents
        },
    )


def _seeds(text: str, suite: str) -> list[int]:
    """Return the seeds of a sweep, none of which is an entry's.

    Raises:
        ValueError: One of them is.
    """
    from sprl_bench import leaderboard

    seeds = parse_seeds(text)
    if "," not in text:
        seeds = [FIRST_SEED + seed for seed in seeds]
    home = leaderboard.home()
    entries = leaderboard.find_entries(home / suite) if (home / suite).is_dir() else []
    used = {result.seed for entry in entries for result in entry.results()}
    used |= {run.spec.seed for one in leaderboard.find_pending(home) if one.suite == suite for run in one.runs}
    for seed in seeds:
        if seed in used or seed < FIRST_SEED:
            raise ValueError(
                f"seeds holds {seed}, which is reserved for leaderboards; it must hold seeds from {FIRST_SEED} on that "
                "no entry uses."
            )
    return seeds


@app.command("report")
def report(
    folder: Annotated[Path, typer.Argument(help="The folder of a sweep.")],
    form: Annotated[str, typer.Option("--format", help="md or csv, on the screen.")] = "md",
) -> None:
    """Rank the settings, choose one by the declared rule, and write page, numbers and pictures into the folder."""
    from sprl_bench import sweeps
    from sprl_bench.records import find_records
    from sprl_bench.sweeps.report import as_csv, render

    check_choice("format", form, ("md", "csv"))
    declaration = sweeps.read_declaration(folder)
    rankings = sweeps.rank(declaration, find_records(folder))
    typer.echo(render(declaration, rankings) if form == "md" else as_csv(rankings), nl=False)
    for path in sweeps.write_report(declaration, rankings, folder):
        typer.echo(f"Wrote {path}.", err=True)
