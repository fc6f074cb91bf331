"""The commands that make a page to look at, and that serve it while runs go on."""

from __future__ import annotations

import webbrowser
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final

import typer

from sprl_bench.cli.found_runs import find_runs, sentence_of
from sprl_bench.cli.leaderboard import BOARD

if TYPE_CHECKING:  # loaded when a command needs them
    from sprl_bench.report import Progress, Source
    from sprl_bench.report.source import Logged
    from sprl_bench.suite import RunState

MOST_LOGGED: Final = 500  # runs whose diagnostics are read

Against = Annotated[Path | None, typer.Option(help=f"Show runs beside a board. {BOARD}")]


def report(
    source: Annotated[Path, typer.Argument(help=f"A folder with runs; or a board. {BOARD}")],
    output: Annotated[Path, typer.Option("-o", "--output", help="The .html file.")] = Path("report.html"),
    against: Against = None,
    allow_missing: Annotated[
        bool, typer.Option("--allow-missing", help="Leave out runs that cannot be read, and name them on the page.")
    ] = False,
    show: Annotated[bool, typer.Option("--open", help="Open the page in a browser.")] = False,
) -> None:
    """Make one page with tables, charts and provenance that opens without a network."""
    from sprl_bench.report import write_report

    if output.suffix.lower() not in (".html", ".htm") and output.parent != Path("/dev"):
        raise ValueError(f"output is {str(output)!r}; it must end in .html.")
    write_report(_source(source, against, allow_missing=allow_missing), output)
    typer.echo(f"Wrote {output}.", err=True)
    if show:
        _open(output)


def _open(page: Path) -> None:
    """Open a page in a browser, or say how to."""
    address = page.resolve().as_uri()
    if not webbrowser.open(address):
        typer.echo(f"No browser was found here; open {address} in one.", err=True)


def watch(
    runs: Annotated[Path, typer.Argument(help="A folder for runs, which may begin later.")],
    host: Annotated[str, typer.Option(help="The address to listen at; others than yours may read the page.")] = (
        "127.0.0.1"
    ),
    port: Annotated[int, typer.Option(min=0, max=65535, help="0 for a free one.")] = 8000,
    every: Annotated[float, typer.Option(min=1, help="Seconds between two looks at the runs.")] = 5,
    against: Against = None,
) -> None:
    """Serve the report of runs, and refresh it while they go on."""
    from sprl_bench.report import make_server, of_runs, render_report

    def page() -> str:
        if _is_empty(runs):
            return render_report(of_runs(runs.resolve().name, [], [], notes=[waiting]), refresh_s=every)
        return render_report(_of_runs(runs, against, allow_missing=True), refresh_s=every)

    waiting = f"There are no runs in {runs} yet."
    if _is_empty(runs):
        typer.echo(f"{waiting} The page waits for them.", err=True)
    server = make_server(page, host=host, port=port, every_s=every)
    shown, number = server.server_address[:2]
    typer.echo(f"Open http://{shown!s}:{number}/ in a browser; Ctrl-C ends it.", err=True)
    with server:
        try:
            server.serve_forever()
        except KeyboardInterrupt:
            typer.echo("Ended.", err=True)


def _is_empty(runs: Path) -> bool:
    """Return whether runs may still begin in a folder: it is empty, or not there."""
    return not runs.exists() or (runs.is_dir() and not any(runs.iterdir()))


def _source(source: Path, against: Path | None, *, allow_missing: bool) -> Source:
    """Return the report's source: of runs if the folder has any, else of a board."""
    from sprl_bench import leaderboard
    from sprl_bench.records.folder import RECORD, SPEC
    from sprl_bench.report import of_board

    if any(path for name in (SPEC, RECORD) for path in source.rglob(name)):
        return _of_runs(source, against, allow_missing=allow_missing)
    if source.is_dir() and not any(source.rglob("*.json")):
        raise FileNotFoundError(f"There are no runs in {source}.")
    if against:
        raise ValueError(f"against is {str(against)!r}; it must be left out where the report is of a board.")
    try:
        entries = leaderboard.find_board(source)
    except FileNotFoundError as error:
        raise FileNotFoundError(f"There is no folder {source} with runs. {error}") from None
    return of_board(source.stem if source.is_file() else source.name, entries)


def _of_runs(runs: Path, against: Path | None, *, allow_missing: bool) -> Source:
    from sprl_bench.leaderboard import find_board
    from sprl_bench.report import of_runs
    from sprl_bench.suite import pace_of

    if runs.exists() and not runs.is_dir():
        raise ValueError(f"runs is {str(runs)!r}; it must be a folder with runs.")
    found = find_runs(runs)
    states = found.states
    if not (allow_missing and states):
        found.refuse_broken()
    if not states:
        raise FileNotFoundError(f"There are no runs in {runs}.")
    logged, notes = _logged(runs, states)
    notes += [f"Cannot be read: {one.error}" for one in found.broken]
    return of_runs(
        runs.resolve().name,
        found.records,
        [_progress(runs, state) for state in states],
        seconds_left=pace_of(states).seconds_left,
        logged=logged,
        entries=find_board(against) if against else (),
        notes=notes,
        unreadable=found.unreadable,
    )


def _progress(runs: Path, state: RunState) -> Progress:
    """Return the progress of a run with the last line of its error, if it failed."""
    from sprl_bench.records import InvalidFileError
    from sprl_bench.records.files import read_bytes
    from sprl_bench.records.folder import ERROR
    from sprl_bench.report import Progress

    path = state.spec.path(runs) / ERROR
    try:
        text = read_bytes(path).decode(errors="replace") if state.status == "failed" else ""
    except (InvalidFileError, FileNotFoundError) as error:
        text = str(error)
    last = (text.strip().splitlines() or [""])[-1]
    return Progress(state.spec, state.status, state.env_steps, state.seconds_left, last[:300])


def _logged(runs: Path, states: Sequence[RunState]) -> tuple[list[Logged], list[str]]:
    """Return the diagnostics of runs, of the first seeds if there are very many, and a note on that."""
    ordered = sorted(states, key=lambda state: state.spec.seed)
    broken: list[str] = []
    lines = [(state.spec, _metrics_of(state.spec.path(runs), broken)) for state in ordered[:MOST_LOGGED]]
    found: list[Logged] = [(spec, of_run) for spec, of_run in lines if of_run]
    left_out = len(states) - len(lines)
    note = f"What agents logged is shown of {len(lines)} of {len(states)} runs, those with the lowest seeds."
    return found, [*broken, *([note] if left_out and found else [])]


def _metrics_of(folder: Path, broken: list[str]) -> list[dict[str, Any]]:
    """Return what an agent logged; none if it is broken, which is added to `broken`."""
    from sprl_bench.records import InvalidFileError, read_metrics

    try:
        return read_metrics(folder)
    except (InvalidFileError, OSError) as error:
        broken.append(sentence_of(error))
        return []
