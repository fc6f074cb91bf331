"""All commands together, and how errors are shown."""

from __future__ import annotations

import contextlib
import os
import signal
import sys
from collections.abc import Sequence
from importlib.metadata import version
from typing import Annotated, Any, Final, cast

import typer

from sprl_bench.cli import leaderboard, sweep
from sprl_bench.cli import list as listing
from sprl_bench.cli.check_agent import check_agent
from sprl_bench.cli.doctor import doctor
from sprl_bench.cli.options import require_command
from sprl_bench.cli.play import play
from sprl_bench.cli.plot import plot
from sprl_bench.cli.power import power
from sprl_bench.cli.report import report, watch
from sprl_bench.cli.reproduce import reproduce
from sprl_bench.cli.run import run
from sprl_bench.cli.status import status
from sprl_bench.cli.streams import open_streams, unbreakable_output
from sprl_bench.cli.table import table
from sprl_bench.cli.verify import reproduce_row, verify
from sprl_bench.cli.video import video
from sprl_bench.extras import extra_of, not_installed

FAILED, MISUSED, INTERRUPTED = 1, 2, 130
WORKING: Final = ("run", "sweep", "reproduce", "reproduce-row", "watch")  # what they print is not their result
UsageError = cast(type[typer.BadParameter], typer.BadParameter.__mro__[1])
"""The parser raises it for a wrong command; typer does not export it."""

app = typer.Typer(
    name="sprl-bench",
    help="The benchmark for sparse-reward reinforcement learning.",
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)
app.add_typer(listing.app, name="list")
for command in (run, status, watch, table, power, plot, report, reproduce, verify, video, play, doctor):
    app.command()(command)
app.command("reproduce-row")(reproduce_row)
app.command("check-agent")(check_agent)
app.add_typer(sweep.app, name="sweep")
app.add_typer(leaderboard.app, name="leaderboard")


def _show_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"sprl-bench {version('sprl-bench')}")
        raise typer.Exit


@app.callback(invoke_without_command=True)
def _options(
    context: typer.Context,
    show_version: Annotated[  # noqa: ARG001 - its callback acts
        bool, typer.Option("--version", is_eager=True, callback=_show_version, help="Print the version and stop.")
    ] = False,
    debug: Annotated[  # noqa: ARG001 - see below
        bool, typer.Option("--debug", help="Show the traceback of every error.")
    ] = False,
) -> None:
    # `main` removes --debug before the parser sees it; it is declared for the help.
    require_command(context)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command and return its exit status.

    Args:
        arguments: Those of the command line when None.
    """
    if arguments is None:
        _prepare_process()
    given = list(sys.argv[1:] if arguments is None else arguments)
    words = [word for word in given if word != "--debug"]
    if len(words) < len(given):
        return _call(words)
    try:
        return _call(words)
    except KeyboardInterrupt:
        return _complain("Interrupted; the same command continues from here.", INTERRUPTED)
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # the reader has closed the pipe
        return FAILED
    except SyntaxError as error:  # of a module that the user named
        where = f"{error.filename}:{error.lineno}: " if error.filename else ""
        return _complain(f"{where}{error.msg}: {(error.text or 'not Python').strip()}", FAILED)
    except (OSError, ValueError, ImportError) as error:
        # A plain ValueError is a wrong argument; its subclasses are about files and runs.
        return _complain(_sentence(error), MISUSED if type(error) is ValueError else FAILED)


def _prepare_process() -> None:
    """Let this process, even the first of a container, end on SIGTERM as on Ctrl-C, and print what its terminal can."""
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    open_streams()


def _call(words: Sequence[str]) -> int:
    try:
        with unbreakable_output() if words and words[0] in WORKING else contextlib.nullcontext():
            status = app(list(words), standalone_mode=False)
            sys.stdout.flush()
    except UsageError as error:
        return _complain(_misuse(error), MISUSED)
    except typer.Abort:
        return _complain("Aborted.", FAILED)
    if status == INTERRUPTED:  # the parser has turned the KeyboardInterrupt into it
        raise KeyboardInterrupt
    return status if isinstance(status, int) else 0


def _misuse(error: Any) -> str:
    """Return what is wrong with the words of a command; for an unknown command, with those that there are."""
    text: str = error.format_message()
    commands = getattr(getattr(error.ctx, "command", None), "commands", None)
    if commands and text.startswith("No such command") and "Did you mean" not in text:
        return f"{text} It must be one of: {', '.join(commands)}."
    return text


def _sentence(error: Exception) -> str:
    if isinstance(error, OSError) and error.strerror and error.filename is not None:
        return f"{error.filename}: {error.strerror}."
    if isinstance(error, ModuleNotFoundError) and error.name and extra_of(error.name):
        return not_installed(error.name)
    return str(error) or type(error).__name__


def _complain(message: str, status: int) -> int:
    line = "".join(letter if letter.isprintable() else "?" for letter in " ".join(message.split()))
    print(f"sprl-bench: {line}", file=sys.stderr)
    return status
