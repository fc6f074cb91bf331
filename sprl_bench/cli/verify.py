"""The commands that repeat runs: by their kept actions, or by training again."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from sprl_bench.cli.options import find_modules_here

if TYPE_CHECKING:  # loaded when a command needs it
    from sprl_bench.replay import Replay


def verify(
    paths: Annotated[
        list[Path], typer.Argument(metavar="RUN|ENTRY...", help="Runs, folders with runs, or files of entries.")
    ],
    runs: Annotated[Path, typer.Option(help="The folder of the runs of an entry.")] = Path("runs"),
    mark: Annotated[bool, typer.Option("--mark", help="Mark entries whose rows are all equal as replayed.")] = False,
) -> int:
    """Repeat runs in their environments alone, by the actions that they kept, and compare every episode and score."""
    replayed = [one for path in paths for one in (_of_entry(path, runs, mark) if path.is_file() else _of_folder(path))]
    equal = sum(replayed)
    typer.echo(f"{equal} of {len(replayed)} runs are replayed equal.")
    return 0 if equal == len(replayed) else 1


def _of_folder(path: Path) -> Iterator[bool]:
    """Replay all runs below a folder, print a line for each, and yield whether it is equal."""
    from sprl_bench.records import InvalidFileError
    from sprl_bench.records.folder import RECORD, find_files
    from sprl_bench.replay import NotReplayableError
    from sprl_bench.replay import verify as verify_run

    folders = [record.parent for record in find_files(path, RECORD)]
    if not folders:
        raise FileNotFoundError(f"{path} has no finished run.")
    for folder in folders:
        try:
            yield _show(verify_run(folder))
        except (NotReplayableError, InvalidFileError) as error:
            print(f"sprl-bench: {error}", file=sys.stderr)
            yield False


def _of_entry(path: Path, runs: Path, mark: bool) -> Sequence[bool]:
    from sprl_bench.leaderboard import read_entry
    from sprl_bench.records import write
    from sprl_bench.replay import verify_entry

    entry = read_entry(path)
    equal = [_show(one) for one in verify_entry(entry, runs)]
    if mark and all(equal):
        write(path, entry.model_copy(update={"evidence": "replayed"}))
        typer.echo(f"Wrote {path}: its evidence is replayed.", err=True)
    return equal


def _show(found: Replay) -> bool:
    verdict = "equal" if found.equal else f"DIFFERENT: {found.difference}"
    typer.echo(f"{found.folder}: {found.env_steps:,} env steps replayed; {verdict}")
    return found.equal


def reproduce_row(
    entry: Annotated[str, typer.Argument(help="The file of an entry.")],
    task: Annotated[str, typer.Option(help="One of its tasks.")],
    seed: Annotated[int, typer.Option(min=0, help="One of its seeds.")],
    agent: Annotated[
        str | None, typer.Option(help="Your own agent must be named, as package.module:factory, to be loaded.")
    ] = None,
    out: Annotated[Path, typer.Option(help="The folder of the new run.")] = Path("runs-again"),
) -> int:
    """Train one row of an entry again, from the entry alone, and compare the curves."""
    from sprl_bench.leaderboard import read_entry
    from sprl_bench.replay import retrain, row_spec

    there = read_entry(Path(entry))
    source = row_spec(there, task, seed).source
    if ":" in source and agent != source:
        raise ValueError(f"agent is {agent!r}; it must be {source!r}, as code is loaded only if you name it (--agent).")
    if ":" in source:
        find_modules_here()
    record, difference = retrain(there, task, seed, out)
    where = f"{there.agent} on {task}, seed {seed}: AUC {record.scores.auc:.4f}"
    if not difference:
        typer.echo(f"{where}; every curve and score is the entry's.")
        return 0
    typer.echo(f"{where}; DIFFERENT: {difference}.")
    typer.echo("Equal curves need the same versions and kind of processor; the entry names its own.", err=True)
    return 1
