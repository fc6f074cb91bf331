"""Commands that work on runs, and tell how far they are."""

# ruff: noqa: PLC0415 - a command loads what it needs when it is called, so that help is quick

from __future__ import annotations

import json
import shlex
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:  # loaded when a command needs them
    from sprl_bench.records import RunSpec
    from sprl_bench.suite import Outcome, RunState

STATUSES = ("finished", "running", "interrupted", "failed", "waiting")

__all__ = ["find_modules_here", "parse_seeds", "parse_settings", "run", "status"]


def run(
    suite: Annotated[str, typer.Option(help="The suite; see: sprl-bench list suites.")],
    agents: Annotated[
        str,
        typer.Option(
            "--agents",
            "--agent",
            help="Agents, with commas between; your own is package.module:factory; "
            "sprl@ablation is sprl by its preset ablation.",
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
        typer.Option("--set", metavar="KEY=VALUE", help="A hyperparameter; may be given several times."),
    ] = None,
    workers: Annotated[int, typer.Option(min=0, help="How many runs at once; 0 for one a core.")] = 0,
    executor: Annotated[str, typer.Option(help="local, ray or slurm.")] = "local",
    device: Annotated[str, typer.Option(help="Where agents compute: auto, cpu, cuda or cuda:N.")] = "auto",
) -> int:
    """Train agents on a suite; the same command again goes on where it stopped."""
    from sprl_bench.executors import make_executor
    from sprl_bench.progress import make_observer
    from sprl_bench.suite import expand, require_device, run_suite
    from sprl_bench.tasks import find_suite

    names = _split(agents, "agents")
    if any(":" in name for name in names):
        find_modules_here()
    specs = expand(
        find_suite(suite),
        names,
        parse_seeds(seeds),
        tasks=task or None,
        budget=budget,
        overrides=parse_settings(setting or ()),
        device=device,
    )
    works = make_executor(executor, workers)
    if executor == "local":  # a cluster's own nodes may have what this machine lacks
        require_device(device)
    outcomes = run_suite(specs, out, executor=works, observer=make_observer())
    return _report(specs, outcomes, out)


def find_modules_here() -> None:
    """Let a module that the user names be found in the current folder, as `python -m` would; workers inherit this."""
    here = str(Path.cwd())
    if here not in sys.path:
        sys.path.insert(0, here)


def _report(specs: Sequence[RunSpec], outcomes: Sequence[Outcome], out: Path) -> int:
    """Show the table of these runs, where they lie, and what to type next; return the exit status."""
    from sprl_bench.cli.reports import print_tables
    from sprl_bench.records import RunRecord, read

    there = [path for spec in specs if (path := spec.path(out) / "record.json").exists()]
    records = [read(path, RunRecord) for path in there]
    complete = any(record.status == "complete" for record in records)
    if complete:
        typer.echo()
        print_tables(records, planned=specs)
    failed = [outcome for outcome in outcomes if outcome.status == "failed"]
    for outcome in failed:
        print(f"sprl-bench: {outcome.spec.path(out)}: {outcome.error}", file=sys.stderr)
    if complete:
        for suite in sorted({spec.suite for spec in specs}):
            typer.echo(f"Records: {out / suite}/*/*/seed-*/record.json")
        typer.echo(f"Next:    sprl-bench table {shlex.quote(str(out))} --format md")
        typer.echo(f"         sprl-bench plot {shlex.quote(str(out))} -o curves.png")
    if failed:
        print(
            f"sprl-bench: {len(failed)} of {len(outcomes)} runs failed; error.txt in their folders tells more, and "
            "the same command tries them again.",
            file=sys.stderr,
        )
    return 1 if failed else 0


def parse_seeds(text: str) -> list[int]:
    """Return the seeds that "5" (0 to 4) or "0,3,7" stand for.

    Raises:
        ValueError: It is neither a positive number nor a list of seeds.
    """
    words = [word.strip() for word in text.split(",") if word.strip()]
    if not words or not all(word.isascii() and word.isdecimal() and len(word) < 16 for word in words):
        raise ValueError(f"seeds is {text!r}; give how many, as in 5, or which, as in 0,3,7.")
    numbers = [int(word) for word in words]
    if "," in text:
        return numbers
    if not 0 < numbers[0] <= 10_000:
        raise ValueError(f"seeds is {text!r}; from 1 to 10000 are allowed (a single seed is written as {text},).")
    return list(range(numbers[0]))


def parse_settings(settings: Sequence[str], option: str = "--set") -> dict[str, object]:
    """Return what "key=value" stand for, as given by a command's `option`: each value JSON if it is, else a string.

    Raises:
        ValueError: There is no "=", a key is there twice, or a value is a number that is not finite.
    """
    chosen: dict[str, object] = {}
    for setting in settings:
        key, equals, value = setting.partition("=")
        if not equals or not key:
            raise ValueError(f"{option} is {setting!r}; it must be KEY=VALUE.")
        if key in chosen:
            raise ValueError(f"{option} gives {key!r} twice.")
        chosen[key] = _value(f"{option} {key}", value)
    return chosen


def _value(name: str, text: str) -> object:
    try:
        value = json.loads(text)
    except json.JSONDecodeError:
        return text
    except (RecursionError, ValueError):
        raise ValueError(f"{name}: {text[:40]!r} is too long or too deep.") from None
    try:
        json.dumps(value, allow_nan=False)
    except ValueError:
        raise ValueError(f"{name}: {text[:40]!r} is not finite.") from None
    return value


def _split(text: str, name: str) -> list[str]:
    words = [word.strip() for word in text.split(",")]
    if not all(words):
        raise ValueError(f"{name} is {text!r}; give names with commas between.")
    return words


def status(runs: Annotated[Path, typer.Argument(help="The folder of all runs.")]) -> int:
    """Tell what is finished, running, failed and left, and for how long; the exit status is 1 where a run failed."""
    from sprl_bench.suite import survey

    states = survey(runs)
    if not states:
        raise FileNotFoundError(f"There are no runs in {runs}.")
    for line in _summary(states):
        typer.echo(line)
    return 1 if any(state.status == "failed" for state in states) else 0


def _summary(states: Sequence[RunState]) -> list[str]:
    """Return a line for each run that is not finished, and one for all."""
    from sprl_bench.progress import duration

    names = [state.status for state in states]
    total = ", ".join(f"{names.count(name)} {name}" for name in dict.fromkeys((*STATUSES, *names)) if name in names)
    running = [state.seconds_left for state in states if state.seconds_left]
    left = f"; the longest of those that run needs {duration(max(running))} more" if running else ""
    lines = [_progress(state) for state in states if state.status != "finished"]
    return [*lines, f"{len(states)} run{'s' * (len(states) > 1)}: {total}{left}."]


def _progress(state: RunState) -> str:
    from sprl_bench.progress import duration

    spec = state.spec
    speed = f", {state.steps_per_second:,.0f} steps/s, {duration(state.seconds_left)} left"
    return (
        f"{state.status:<11}  {spec.suite}/{spec.task.name}/{spec.agent}/seed-{spec.seed}  "
        f"{state.env_steps:,} of {spec.task.budget:,} environment steps{speed if state.status == 'running' else ''}"
    )
