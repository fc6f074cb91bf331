"""Boards: folders of entries, each checked when read, from which tables are computed."""

from __future__ import annotations

import contextlib
import json
import logging
from collections.abc import Iterable, Sequence
from pathlib import Path

from sprl_bench.durations import duration
from sprl_bench.leaderboard.entries import Entry
from sprl_bench.leaderboard.pending import FOLDER, is_pending, read_pending
from sprl_bench.leaderboard.submission import check_entry
from sprl_bench.records import InvalidFileError, locate, read, write
from sprl_bench.shipped import find_shipped
from sprl_bench.suggestions import unknown
from sprl_bench.tables import IncomparableError, Table, check_comparable, tabulate_results
from sprl_bench.tasks import SUITES

logger = logging.getLogger("sprl_bench")

SCHEMA = "schema.json"


class OutdatedEntryError(InvalidFileError):
    """An entry for an earlier version of its suite."""


def home() -> Path:
    """Return the folder of the published boards, in the checkout or in an installed wheel."""
    return find_shipped(f"leaderboards/{SCHEMA}").parent


def own_home() -> Path:
    """Return the folder for new entries: ./leaderboards, never the copy in an installed wheel.

    Raises:
        FileNotFoundError: There is none in the current folder.
    """
    folder = Path("leaderboards")
    if not folder.is_dir():
        raise FileNotFoundError("There is no folder leaderboards here to write to; name one with --home.")
    return folder


def entry_path(folder: str | Path, suite: str, agent: str) -> Path:
    """Return the path of an entry below the folder of all boards."""
    return Path(folder) / suite / f"{agent}.json"


def read_entry(path: str | Path) -> Entry:
    """Read an entry and check its content, its suite, its agent and its path.

    Raises:
        OutdatedEntryError: The suite has a newer version.
        InvalidFileError: It is invalid; the message names the file, the line and the error.
        FileNotFoundError: There is no such file.
    """
    path = Path(path)
    entry = read(path, Entry)
    try:
        check_entry(entry)
    except ValueError as error:
        is_older = entry.suite in SUITES and entry.suite_version < SUITES[entry.suite].version
        kind = OutdatedEntryError if is_older else InvalidFileError
        raise kind(f"{path}:{_line(path, str(error))}: {error}") from None
    place = entry_path(Path(), entry.suite, entry.agent)
    if path.resolve().parts[-2:] != place.parts:
        raise InvalidFileError(f"{path}:1: the entry of {entry.agent} on {entry.suite} belongs in {place}")
    return entry


def _line(path: Path, complaint: str) -> int:
    place = complaint.partition(":")[0].split(".")
    return locate(path, tuple(int(part) if part.isdecimal() else part for part in place))


def find_entries(folder: str | Path) -> list[Entry]:
    """Read all entries of one board; a warning names those for an earlier version of its suite, which are left out.

    Raises:
        InvalidFileError: One of them is broken.
        FileNotFoundError: There is no such folder.
        ValueError: It is the folder of all boards.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise FileNotFoundError(f"{folder} is not a folder of leaderboard entries.")
    _refuse_all_boards(folder)
    return _read_current(sorted(folder.glob("*.json")))


def _read_current(paths: Iterable[Path]) -> list[Entry]:
    entries, outdated = [], []
    for path in paths:
        try:
            entries.append(read_entry(path))
        except OutdatedEntryError:
            outdated.append(str(path))
    if outdated:
        logger.warning("Left out, for an earlier version of the suite: %s.", ", ".join(outdated))
    return entries


def find_board(name: str | Path) -> list[Entry]:
    """Return the entries of a board's name or folder, or that of one file.

    Raises:
        InvalidFileError: An entry is broken.
        FileNotFoundError: There is nothing of that name.
        ValueError: It is the folder of all boards.
    """
    name = Path(name)
    if name.is_file():
        return [read_entry(name)]
    _refuse_all_boards(name)
    folder = name if any(name.glob("*.json")) else home() / name
    if not folder.is_dir():
        raise FileNotFoundError(unknown("entry or board", str(name), _names(home())))
    return find_entries(folder)


def _refuse_all_boards(folder: Path) -> None:
    if (folder / SCHEMA).exists() or any(folder.glob("*/*.json")):
        raise ValueError(
            f"{folder} is the folder of all boards; name one of them: {', '.join(_names(folder)) or 'none yet'}."
        )


def _names(folder: Path) -> list[str]:
    """Return the names of the boards below the folder of all boards."""
    if not folder.is_dir():
        return []
    return sorted(path.name for path in folder.iterdir() if path.is_dir() and path.name != FOLDER)


def validate(paths: Iterable[str | Path]) -> list[str]:
    """Return one line for each file that is no valid entry, or not comparable with those in its folder.

    Files of pending runs are checked, too.
    """
    complaints = []
    for path in map(Path, paths):
        try:
            if is_pending(path):
                read_pending(path)
            else:
                _check_beside(read_entry(path), path)
        except InvalidFileError as error:
            complaints.append(str(error))
        except IncomparableError as error:
            complaints.append(f"{path}:1: {error}")
        except OSError as error:
            complaints.append(f"{path}: {error.strerror}")
    return complaints


def _check_beside(entry: Entry, path: Path) -> None:
    """Check that an entry is comparable with each valid one in its folder."""
    others: list[tuple[str, Entry]] = []
    for place in sorted(path.parent.glob("*.json")):
        with contextlib.suppress(InvalidFileError, OSError):
            others.append((place.name, read_entry(place)))
    for name, other in others:
        try:
            check_comparable([*entry.results(), *(other.results() if other.agent != entry.agent else ())])
        except IncomparableError as error:
            raise IncomparableError(f"beside {name}: {error}") from None


def board(entries: Sequence[Entry]) -> Table:
    """Return the table of one suite's entries, the highest mean AUC first.

    Raises:
        IncomparableError: They are not comparable.
        ValueError: There is no entry.
    """
    if not entries:
        raise ValueError("This board has no entry yet.")
    table = tabulate_results([result for entry in entries for result in entry.results()])
    by_agent = {entry.agent: entry for entry in entries}
    sources = [_source(by_agent[row.agent]) for row in table.rows]
    return table.model_copy(update={"notes": (*table.notes, *sources)})


def _source(entry: Entry) -> str:
    """Return where an entry is from, and what its runs cost where that is known."""
    cost = "" if entry.wall_time_s is None else f"; all runs together took {duration(entry.wall_time_s)}"
    return f"{entry.agent}: {entry.status}, {entry.evidence}; {', '.join(entry.authors)}; {entry.link}{cost}"


def boards(folder: str | Path, suite: str | None = None) -> list[Table]:
    """Return the boards below a folder, or that of one suite.

    Raises:
        ValueError: There is no entry, or no board of that name.
        InvalidFileError: An entry is broken.
    """
    folder = Path(folder)
    names = _names(folder)
    if suite is not None and suite not in names:
        raise ValueError(unknown("leaderboard", suite, names))
    found = [find_entries(folder / name) for name in names if suite in (None, name)]
    tables = [board(entries) for entries in found if entries]
    if not tables:
        raise ValueError(f"{folder} has no entry for a current suite; make one with: sprl-bench leaderboard add")
    return tables


def add_entry(entry: Entry, folder: str | Path, *, replace: bool = False) -> Path:
    """Write an entry below the folder of all boards and return its path.

    Raises:
        FileExistsError: There is one of that name, and `replace` is false.
        IncomparableError: It is not comparable with the other entries.
        InvalidFileError: One of those is broken.
    """
    path = entry_path(Path(folder), entry.suite, entry.agent)
    if path.exists() and not replace:
        raise FileExistsError(f"{path} exists; replace it with --replace.")
    others = _read_current(other for other in sorted(path.parent.glob("*.json")) if other != path)
    check_comparable([result for one in (*others, entry) for result in one.results()])
    write(path, entry)
    return path


def schema() -> str:
    """Return the JSON schema of an entry, the content of `leaderboards/schema.json`."""
    return json.dumps(Entry.model_json_schema(), indent=1, sort_keys=True, ensure_ascii=False) + "\n"
