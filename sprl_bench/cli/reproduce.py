"""The command that repeats the paper's experiments."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from sprl_bench.cli.options import KeepActions, Tasks, find_modules_here, note_short_budgets, parse_seeds

if TYPE_CHECKING:  # loaded when the command needs it
    from sprl_bench.records import RunSpec
    from sprl_bench.studies import Evidence


def reproduce(
    study: Annotated[str, typer.Argument(help="Which study, such as fig10; or list.")],
    seeds: Annotated[str, typer.Option(help="How many seeds, from 0; or the seeds themselves, as in 0,3,7.")] = "5",
    budget_share: Annotated[float, typer.Option(help="The budgets, as a share of the tasks' own.")] = 1.0,
    base: Annotated[
        str | None, typer.Option(help="Vary this agent instead, as in sprl@ablation; for studies of one agent.")
    ] = None,
    task: Tasks = None,
    out: Annotated[Path, typer.Option(help="The folder of the runs and the page.")] = Path("studies"),
    runs: Annotated[Path | None, typer.Option(help="Train nothing; judge the runs in this folder.")] = None,
    board: Annotated[
        str | None, typer.Option(help="Train nothing; judge the entries of this leaderboard, as grid-7x7.")
    ] = None,
    workers: Annotated[int, typer.Option(min=0, help="How many runs at once; 0 for one a core.")] = 0,
    executor: Annotated[str, typer.Option(help="local, ray or slurm.")] = "local",
    device: Annotated[str, typer.Option(help="Where agents compute: auto, cpu, cuda or cuda:N.")] = "auto",
    keep_actions: KeepActions = False,
) -> int:
    """Run one of the paper's experiments, draw its figure and judge its claim; the same command again continues."""
    from sprl_bench import studies
    from sprl_bench.suite import too_short

    if study == "list":
        for row in studies.STUDIES.values():
            typer.echo(f"{row.name}  {row.title}")
        return 0
    chosen = studies.find_study(study)
    if base is not None and ":" in base:
        find_modules_here()
    agents = chosen.on_base(base) if base is not None else chosen.agents
    specs = studies.specs_of(chosen, parse_seeds(seeds), budget_share, agents=agents, tasks=task or None, device=device)
    if board is not None and runs is not None:
        raise ValueError(f"board is {board!r}; it must be left out where --runs names a folder.")
    failed = 0
    if runs is None and board is None and specs:
        failed = _train(specs, out, executor, workers, keep_actions=keep_actions)
    evidence = _entries(board, specs) if board else _runs(study, specs, runs, out)
    verdict = chosen.judge(evidence, agents)
    missing = studies.missing_runs(specs, evidence)
    short = too_short(specs)
    command = _command(study, seeds, budget_share, base, task, board, out)
    out.mkdir(parents=True, exist_ok=True)
    for path in studies.write_study(chosen, evidence, verdict, out, command=command, missing=missing, short=short):
        typer.echo(f"Wrote {path}.", err=True)
    typer.echo(f"Claim:   {chosen.claim}")
    typer.echo(f"Verdict: {verdict.short}")
    for difference in verdict.differences:
        typer.echo(f"         {difference}")
    for sentence in short:
        typer.echo(f"Note:    {sentence}")
    if missing:
        typer.echo(f"{len(missing)} of {len(specs)} runs are missing: {missing[0]}, ...", err=True)
    return 1 if failed else 0


def _train(specs: Sequence[RunSpec], out: Path, executor: str, workers: int, *, keep_actions: bool) -> int:
    """Train what is missing, and return how many runs failed."""
    from sprl_bench.executors import make_executor
    from sprl_bench.progress import make_observer
    from sprl_bench.suite import run_suite

    typer.echo(f"{len(specs)} runs, {sum(spec.task.budget for spec in specs):,} env steps.", err=True)
    note_short_budgets(specs)
    works = make_executor(executor, workers)
    outcomes = run_suite(specs, out, executor=works, observer=make_observer(), keep_actions=keep_actions)
    return sum(outcome.status == "failed" for outcome in outcomes)


def _runs(study: str, specs: Sequence[RunSpec], runs: Path | None, out: Path) -> Evidence:
    from sprl_bench import studies

    evidence = studies.evidence_of(specs, runs or out) if specs else studies.Evidence()
    if runs is not None and specs and not evidence.results:
        raise FileNotFoundError(_none_of_these(study, specs, runs))
    return evidence


def _entries(board: str, specs: Sequence[RunSpec]) -> Evidence:
    from sprl_bench import leaderboard, studies

    results = [result for entry in leaderboard.find_board(board) for result in entry.results()]
    evidence = studies.evidence_of_entries(specs, results)
    if not evidence.results:
        such = f", such as {specs[0].agent} on {specs[0].task.name}" if specs else ""
        raise ValueError(f"board is {board!r}; it must be one with entries that the study asks for{such}.")
    return evidence


def _none_of_these(study: str, specs: Sequence[RunSpec], runs: Path) -> str:
    """Return a sentence that says what a study needs and what the folder holds instead."""
    from sprl_bench.records import find_records

    there = sorted({f"{one.spec.agent} on {one.spec.task.name}, seed {one.spec.seed}" for one in find_records(runs)})
    first, more = specs[0], f" and {len(there) - 3} more" * (len(there) > 3)
    return (
        f"{runs} holds no finished run of {study} with these seeds and budgets, such as {first.agent} on "
        f"{first.task.name}, seed {first.seed}; it holds {'; '.join(there[:3])}{more}."
        if there
        else f"{runs} holds no finished run; {study} needs {len(specs)}."
    )


def _command(
    study: str,
    seeds: str,
    budget_share: float,
    base: str | None,
    tasks: list[str] | None,
    board: str | None,
    out: Path,
) -> str:
    """Return the command that repeats a study."""
    words = ["sprl-bench", "reproduce", study, "--seeds", seeds]
    words += ["--budget-share", f"{budget_share:g}"] if budget_share != 1 else []
    words += ["--base", base] if base else []
    words += ["--board", board] if board else []
    words += [word for name in tasks or () for word in ("--task", name)]
    return shlex.join([*words, "--out", str(out)])
