"""Commands around the leaderboards."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, cast

import typer

from sprl_bench.cli import options
from sprl_bench.cli.found_runs import find_runs

if TYPE_CHECKING:  # loaded when a command needs it
    from sprl_bench.leaderboard.submission import Status
    from sprl_bench.records import RunRecord, RunSpec
    from sprl_bench.tables import Table

app = typer.Typer(
    help="Show, check, extend and challenge the leaderboards.",
    callback=options.require_command,
    invoke_without_command=True,
)

BOARD = "A board's name or folder, as grid-7x7 or leaderboards/grid-7x7, or the file of one entry."

Home = Annotated[Path | None, typer.Option("--home", help="The folder of all boards; by default the published ones.")]
OwnHome = Annotated[Path | None, typer.Option("--home", help="The folder of all boards; by default ./leaderboards.")]
Seeds = Annotated[
    str | None, typer.Option(help="Only these: how many, from 0; or the seeds themselves, as in 5,6,7. By default all.")
]
ComparisonFormat = Annotated[
    str | None, typer.Option("--format", help="rich, md, latex or json; by default by the file's suffix.")
]


@app.command("show")
def show(
    suite: Annotated[str | None, typer.Argument(help="The suite; by default all.")] = None,
    pending: Annotated[bool, typer.Option("--pending", help="The runs in ./leaderboards/pending.")] = False,
    form: options.Format = None,
    output: options.Output = None,
    columns: options.Columns = None,
    home: Home = None,
) -> None:
    """Show the boards, computed from their entries."""
    from sprl_bench import leaderboard
    from sprl_bench.tables import FORMATS, render

    form = options.choose_format(form, output, FORMATS)
    if pending:
        boards = _pending_tables(home or leaderboard.own_home(), suite)
    else:
        boards = leaderboard.boards(home or leaderboard.home(), suite)
    chosen = options.split_names(columns, "columns") if columns is not None else None
    options.deliver(render(boards, form, width=options.terminal_width(output), columns=chosen), output)


def _pending_tables(home: Path, suite: str | None) -> list[Table]:
    """Return the tables of the pending runs, with a note for each entry that is not complete."""
    from sprl_bench import leaderboard
    from sprl_bench.tables import tabulate

    found = [one for one in leaderboard.find_pending(home) if suite in (None, one.suite)]
    if not found:
        raise ValueError(f"{home} has no pending run{f' of suite {suite!r}' if suite else ''}.")
    for one in found:
        typer.echo(
            f"{one.suite}, {one.agent}: {len(one.runs)} runs, {leaderboard.missing_runs(one)} missing.", err=True
        )
    return tabulate([run for one in found for run in one.runs], allow_missing=True)


@app.command("validate")
def validate(files: Annotated[list[Path], typer.Argument(help="Entries.")]) -> int:
    """Check entries; one line on stderr for each invalid one."""
    from sprl_bench import leaderboard
    from sprl_bench.leaderboard.pending import is_pending

    complaints = leaderboard.validate(files)
    for line in complaints:
        typer.echo(line, err=True)
    typer.echo(f"{len(files) - len(complaints)} of {len(files)} entries are valid.")
    if complaints:
        return 1
    for file in files:
        if not is_pending(file) and leaderboard.read_entry(file).evidence == "replayed":
            typer.echo(f"{file} says that it is replayed; only sprl-bench verify, with its runs, can show that.")
    return 0


STATUSES = ("reported", "reproduced")
Authors = Annotated[list[str] | None, typer.Option("--author", "--authors", help="May be given several times.")]
Link = Annotated[str | None, typer.Option(help="The paper or the code.")]
EntryStatus = Annotated[str, typer.Option("--status", help="reported, or reproduced: run again by someone else.")]
Replace = Annotated[bool, typer.Option("--replace", help="Overwrite an entry of the same name.")]


@app.command("add")
def add(
    runs: options.Runs,
    agent: Annotated[str, typer.Option(help="The agent.")],
    authors: Authors = None,
    link: Link = None,
    suite: Annotated[str | None, typer.Option(help="Needed if the agent has runs of several suites.")] = None,
    status: EntryStatus = "reported",
    seeds: Seeds = None,
    replace: Replace = False,
    pending: Annotated[
        bool,
        typer.Option("--pending", help="Keep the finished runs, as many as there are, until the entry is complete."),
    ] = False,
    home: OwnHome = None,
) -> None:
    """Make an entry from an agent's runs: at least five seeds, the same on all tasks of the suite."""
    from sprl_bench import leaderboard

    options.check_choice("status", status, STATUSES)
    records, planned = runs_of(runs, seeds, suites=[suite] if suite else None, agent=agent)
    home = home or leaderboard.own_home()
    if not pending:
        _write_entry(records, agent, authors, link, suite, status, home, replace, planned)
        return
    for path in leaderboard.add_pending(records, home, agent=agent, suite=suite):
        kept = leaderboard.read_pending(path)
        typer.echo(f"Wrote {path}: {len(kept.runs)} runs, {leaderboard.missing_runs(kept)} missing.", err=True)


@app.command("promote")
def promote(
    suite: Annotated[str, typer.Option(help="The suite.")],
    agent: Annotated[str, typer.Option(help="The agent.")],
    authors: Authors = None,
    link: Link = None,
    status: EntryStatus = "reported",
    replace: Replace = False,
    home: OwnHome = None,
) -> None:
    """Make an entry from an agent's pending runs, and remove those."""
    from sprl_bench import leaderboard

    options.check_choice("status", status, STATUSES)
    home = home or leaderboard.own_home()
    path = leaderboard.pending_path(home, suite, agent)
    _write_entry(leaderboard.read_pending(path).runs, agent, authors, link, suite, status, home, replace)
    path.unlink()


def _write_entry(
    records: Sequence[RunRecord],
    agent: str,
    authors: list[str] | None,
    link: str | None,
    suite: str | None,
    status: str,
    home: Path,
    replace: bool,
    planned: Sequence[RunSpec] = (),
) -> None:
    from sprl_bench import leaderboard

    if not authors or not link:
        raise ValueError(f"{'link' if authors else 'author'} is missing; an entry must name its authors and a link.")
    entry = leaderboard.make_entry(
        records, agent=agent, authors=authors, link=link, suite=suite, status=cast("Status", status), planned=planned
    )
    typer.echo(f"Wrote {leaderboard.add_entry(entry, home, replace=replace)}.", err=True)


@app.command("compare")
def compare(
    runs: options.Runs,
    against: Annotated[Path, typer.Option(help=BOARD)],
    agent: Annotated[str | None, typer.Option(help="The agent; by default all.")] = None,
    task: options.Tasks = None,
    seeds: Seeds = None,
    form: ComparisonFormat = None,
    output: options.Output = None,
) -> None:
    """Compare runs with entries: the difference of mean AUC with its interval, paired by task."""
    from sprl_bench import leaderboard

    form = options.choose_format(form, output, leaderboard.COMPARISON_FORMATS)
    entries = leaderboard.find_board(against)
    records, planned = runs_of(runs, seeds, suites=[entry.suite for entry in entries], agent=agent)
    compared = leaderboard.compare(records, entries, agent=agent, tasks=task or None, planned=planned)
    options.deliver(leaderboard.render_comparisons(compared, form, width=options.terminal_width(output)), output)


@app.command("plot")
def plot(
    board: Annotated[Path, typer.Argument(help=BOARD)],
    output: options.Picture,
    runs: Annotated[Path | None, typer.Option(help="A folder with runs to draw beside the entries.")] = None,
    task: options.Tasks = None,
    agent: options.Agents = None,
    kind: options.Kind = "curves",
    width: options.Width = None,
    allow_missing: options.AllowMissing = False,
) -> None:
    """Draw the learning curves of a board's entries, one panel a task, or another picture of them."""
    from sprl_bench import leaderboard, plots

    options.check_choice("kind", kind, ("curves", *plots.KINDS))
    entries = leaderboard.find_board(board)
    records, planned = runs_of(runs, None, suites=[entries[0].suite]) if runs else ([], [])
    results, wanted = leaderboard.side_by_side(entries, records, planned=planned, agents=agent or None)
    if runs and not any(spec.suite == entries[0].suite for spec in wanted):
        raise ValueError(f"There is no run of suite {entries[0].suite!r} in {runs}.")
    chosen: dict[str, Any] = {"tasks": task or None, "planned": wanted, "allow_missing": allow_missing}
    if kind == "curves":
        plots.plot_results(results, output, width=width, **chosen)
    else:
        labels = plots.suite_labels(results)
        plots.plot_suites(plots.board_matrices(results, **chosen), output, kind, width=width, labels=labels)
    typer.echo(f"Wrote {output}.", err=True)


def runs_of(
    folder: Path, seeds: str | None, *, suites: Collection[str] | None, agent: str | None = None
) -> tuple[list[RunRecord], list[RunSpec]]:
    """Return the records and the plans below a folder, all of them or those of some seeds.

    Raises:
        InvalidFileError: A run of these suites and this agent cannot be read.
    """
    found = find_runs(folder)
    found.refuse_broken(suites, agent)
    records, planned = found.records, found.planned
    if seeds is None:
        return records, planned
    chosen = options.parse_seeds(seeds)
    if without := sorted(set(chosen) - {one.spec.seed for one in records}):
        raise ValueError(f"seeds is {seeds!r}, but {folder} has no run of seed {', '.join(map(str, without))}.")
    return [one for one in records if one.spec.seed in chosen], [one for one in planned if one.seed in chosen]


@app.command("schema")
def schema(output: options.Output = None) -> None:
    """Print the JSON schema of an entry, the content of leaderboards/schema.json."""
    from sprl_bench import leaderboard

    options.deliver(leaderboard.schema(), output)
