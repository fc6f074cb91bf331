"""The command that repeats runs by their kept actions."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer


def verify(
    paths: Annotated[list[Path], typer.Argument(metavar="RUN...", help="Runs, or folders with runs.")],
) -> int:
    """Repeat runs in their environments alone, by the actions that they kept, and compare every episode and score."""
    from sprl_bench.records.folder import RECORD
    from sprl_bench.replay import NotReplayableError
    from sprl_bench.replay import verify as verify_run

    folders = [record.parent for path in paths for record in sorted(path.rglob(RECORD))]
    if not folders:
        raise FileNotFoundError(f"{', '.join(map(str, paths))}: there is no finished run.")
    failed = 0
    for folder in folders:
        try:
            found = verify_run(folder)
        except NotReplayableError as error:
            failed += 1
            print(f"sprl-bench: {error}", file=sys.stderr)
            continue
        failed += not found.equal
        verdict = f"DIFFERENT: {found.difference}" if not found.equal else "equal"
        typer.echo(f"{folder}: {found.env_steps:,} env steps replayed; {verdict}")
    typer.echo(f"{len(folders) - failed} of {len(folders)} runs are replayed equal.")
    return 1 if failed else 0
