"""The command that trains agents on a suite."""

from __future__ import annotations

import contextlib
import shlex
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from sprl_bench.cli.options import (
    KeepActions,
    find_modules_here,
    note_short_budgets,
    parse_seeds,
    program_name,
    split_names,
)
from sprl_bench.naming import parse_settings

if TYPE_CHECKING:  # loaded when the command needs them
    from sprl_bench.records import RunRecord, RunSpec
    from sprl_bench.suite import Outcome


def run(
    suite: Annotated[str, typer.Option(help="The suite; see: sprl-bench list suites.")],
    agents: Annotated[
        str,
        typer.Option(
            "--agents",
            "--agent",
            help="Agents, with commas between; your own as package.module:factory; a preset as in sprl@ablation, and "
            "other settings as in sprl@ablation+k=3+tolerance=25.",
        ),
    ],
    seeds: Annotated[str, typer.Option(help="How many seeds, from 0; or the seeds themselves, as in 0,3,7.")] = "5",
    out: Annotated[Path, typer.Option(help="The folder of all runs.")] = Path("runs"),
    task: Annotated[
        list[str] | None, typer.Option("--task", help="Only this task; may be given several times.")
    ] = None,
    budget: Annotated[int | None, typer.Option(min=1, help="Environment steps, instead of each task's own.")] = None,
    setting: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="KEY=VALUE", help="A hyperparameter of all agents; may be given several times."),
    ] = None,
    workers: Annotated[int, typer.Option(min=0, help="How many runs at once; 0 for one a core.")] = 0,
    executor: Annotated[str, typer.Option(help="local, ray or slurm.")] = "local",
    cores: Annotated[int, typer.Option(min=0, help="Cores of each run on a cluster; 0 for one a thread.")] = 0,
    gpu_share: Annotated[float, typer.Option(help="Share of a GPU of each run on a cluster.")] = 1.0,
    memory_gib: Annotated[float, typer.Option(min=0, help="Memory of each run on a cluster; 0 to ask for none.")] = 0,
    device: Annotated[str, typer.Option(help="Where agents compute: auto, cpu, cuda or cuda:N.")] = "auto",
    log: Annotated[
        str, typer.Option(help="Where diagnostics go, too: tensorboard, or your own as package.module:factory.")
    ] = "",
    keep_actions: KeepActions = False,
    known: Annotated[
        Path | None, typer.Option(help="A folder of pending runs, which count as finished: leaderboards/pending.")
    ] = None,
) -> int:
    """Train agents on a suite; the same command again continues where it stopped."""
    from sprl_bench.executors import Resources, make_executor
    from sprl_bench.leaderboard import find_pending, split_known
    from sprl_bench.progress import make_observer
    from sprl_bench.sinks import find_sink
    from sprl_bench.suite import expand, require_device, run_suite
    from sprl_bench.tasks import find_suite

    names = split_names(agents, "agents")
    if any(":" in name for name in (*names, log)):
        find_modules_here()
    find_sink(log)
    specs = expand(
        find_suite(suite),
        names,
        parse_seeds(seeds),
        tasks=task or None,
        budget=budget,
        overrides=parse_settings(setting or ()),
        device=device,
    )
    works = make_executor(executor, workers, Resources(cores, gpu_share, memory_gib))
    if executor == "local":  # the nodes of a cluster may have other devices
        require_device(device)
    left, found = split_known(specs, find_pending(known)) if known else (specs, [])
    if found:
        typer.echo(f"{len(found)} of {len(specs)} runs are known from {known}.", err=True)
    note_short_budgets(left)
    outcomes = run_suite(left, out, executor=works, observer=make_observer(), log=log, keep_actions=keep_actions)
    return _report(left, found, outcomes, out)


def _report(specs: Sequence[RunSpec], known: Sequence[RunRecord], outcomes: Sequence[Outcome], out: Path) -> int:
    """Show the table of these runs, their folder, and the next commands; return the exit status."""
    from sprl_bench.cli.table import print_tables
    from sprl_bench.records.folder import ERROR, RECORD, run_path

    records = [*known, *(record for spec in specs if (record := _record_of(spec.path(out) / RECORD)))]
    complete = any(record.status == "complete" for record in records)
    if complete:
        typer.echo()
        print_tables(records, specs, {one.spec.path(Path()): one.status for one in outcomes})
    failed = [outcome for outcome in outcomes if outcome.status == "failed"]
    for outcome in failed:
        print(f"sprl-bench: {outcome.spec.path(out)}: {outcome.error}", file=sys.stderr)
    if complete:
        for suite in sorted({spec.suite for spec in specs}):
            typer.echo(f"Records: {out / run_path(suite, '*', '*', '*') / RECORD}")
        program, runs = program_name(), shlex.quote(str(out))
        typer.echo(f"Next:    {program} report {runs} --open")
        typer.echo(f"         {program} table {runs} --format md")
        typer.echo(f"         {program} plot {runs} -o curves.png")
    if failed:
        has_error_file = any((one.spec.path(out) / ERROR).exists() for one in failed)
        why = f"{ERROR} in their folders says why, and the" if has_error_file else "the"
        print(
            f"sprl-bench: {len(failed)} of {len(outcomes)} runs failed; {why} same command tries them again.",
            file=sys.stderr,
        )
    return 1 if failed else 0


def _record_of(path: Path) -> RunRecord | None:
    """Return a record; None if there is none, or a broken one, whose run has failed."""
    from sprl_bench.records import InvalidFileError, RunRecord, read

    with contextlib.suppress(InvalidFileError, OSError):
        return read(path, RunRecord)
    return None
