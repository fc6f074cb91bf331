"""A run's folder: its path, the names of its files, and the lock that lets one process at a time write there."""

from __future__ import annotations

import contextlib
import errno
import fcntl
import functools
import logging
import os
import socket
import stat
import time
from collections.abc import Callable, Collection, Iterator
from pathlib import Path
from typing import Final

logger = logging.getLogger("sprl_bench")

RECORD: Final = "record.json"
EPISODES: Final = "episodes.parquet"
METRICS: Final = "metrics.jsonl"
ACTIONS: Final = "actions.tape"
CHECKPOINT: Final = "checkpoint.safetensors"
WEIGHTS: Final = "weights.safetensors"
SPEC: Final = "spec.json"
ERROR: Final = "error.txt"
OUTPUT: Final = "output.txt"
LOCK: Final = ".lock"

APPEND: Final = os.O_WRONLY | os.O_CREAT | os.O_APPEND  # how a log is opened
NO_LOCKS: Final = (errno.ENOSYS, errno.EOPNOTSUPP, errno.ENOLCK)
PATIENCE_S: Final = 0.5  # `is_locked` takes the lock for a moment


def run_path(suite: str, task: str, agent: str, seed: int | str) -> Path:
    """Return a run's folder, relative to the root of all runs; each part may be a pattern such as "*"."""
    return Path(suite, task, agent, f"seed-{seed}")


def _raise(error: OSError) -> None:
    raise error


def find_files(root: Path, name: str, on_error: Callable[[OSError], None] = _raise) -> list[Path]:
    """Return all files of a name below a folder, sorted, as `find_folders` finds their folders."""
    return [folder / name for folder in find_folders(root, (name,), on_error)]


def find_folders(root: Path, names: Collection[str], on_error: Callable[[OSError], None] = _raise) -> list[Path]:
    """Return all folders below a folder that hold a file of one of these names, sorted; none if there is no root.

    Linked folders are searched too, each folder once.

    Args:
        root: The folder.
        names: Those of the files.
        on_error: Receives the error of each folder that may not be read.

    Raises:
        PermissionError: By default, if a folder may not be read.
    """
    if not root.exists():
        return []
    found, seen = [], set[tuple[int, int]]()
    for folder, folders, files in os.walk(root, onerror=on_error, followlinks=True):
        status = os.stat(folder)  # noqa: PTH116 - a path for each folder would be slow
        if (status.st_dev, status.st_ino) in seen:
            folders.clear()
            continue
        seen.add((status.st_dev, status.st_ino))
        if not set(names).isdisjoint(files):
            found.append(Path(folder))
    return sorted(found)


def open_own(path: Path, flags: int) -> int:
    """Open a file of a run's folder, and return its descriptor. A link is never followed, and a pipe is not waited for.

    Raises:
        IrregularFileError: It is a link, a pipe or a device.
    """
    try:
        descriptor = os.open(path, flags | os.O_NOFOLLOW | os.O_CLOEXEC | os.O_NONBLOCK, 0o666)
    except OSError as error:
        if error.errno == errno.ENXIO:  # a pipe that nobody reads
            raise IrregularFileError(f"{path} is not a regular file; it must be one.") from None
        if error.errno != errno.ELOOP:
            raise
        raise IrregularFileError(f"{path} is a link; it must be a file. A run's whole folder may be a link.") from None
    if not stat.S_ISREG(os.fstat(descriptor).st_mode):
        os.close(descriptor)
        raise IrregularFileError(f"{path} is not a regular file; it must be one.")
    return descriptor


def seeds_beside(folder: Path) -> list[Path]:
    """Return the folders of all seeds of a run's suite, task and agent, its own included."""
    return sorted(folder.parent.glob(run_path("", "", "", "*").name))


class IrregularFileError(OSError):
    """A file inside a run's folder is a link to somewhere else, a pipe or a device, or the folder itself is none."""


class LockedError(RuntimeError):
    """Another process works in this folder."""


@contextlib.contextmanager
def lock(folder: Path) -> Iterator[None]:
    """Keep other processes out of a run's folder; the lock ends with the context or with the process.

    Raises:
        LockedError: Another process works in this folder.
    """
    descriptor = _acquire(folder)
    try:
        os.ftruncate(descriptor, 0)
        os.write(descriptor, f"process {os.getpid()} on {socket.gethostname()}".encode())
        yield
    finally:
        (folder / LOCK).unlink(missing_ok=True)
        os.close(descriptor)


def _acquire(folder: Path) -> int:
    _make(folder)
    deadline = time.monotonic() + PATIENCE_S
    while (descriptor := _try(folder / LOCK)) is None:
        if time.monotonic() > deadline:
            raise LockedError(f"{folder} is in use by another process ({_holder(folder)}).")
        time.sleep(0.02)
    return descriptor


def _make(folder: Path) -> None:
    """Make a folder unless it is there.

    Raises:
        IrregularFileError: It, or one above it, is a link that points nowhere, or a file.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except (FileExistsError, NotADirectoryError):
        blocks = [one for one in (folder, *folder.parents) if os.path.lexists(one) and not one.is_dir()]
        if not blocks:
            raise
        is_link = blocks[0].is_symlink()
        what = "is a link that points nowhere; it must be a folder" if is_link else "is not a folder; it must be one"
        raise IrregularFileError(f"{blocks[0]} {what}.") from None


def _try(path: Path) -> int | None:
    """Return an open, locked file, or None if another process holds the lock."""
    descriptor = open_own(path, os.O_RDWR | os.O_CREAT)
    try:
        _flock(descriptor, fcntl.LOCK_EX)
        # The process that held it may have removed the file between our opening and locking it.
        if path.exists() and path.stat().st_ino == os.fstat(descriptor).st_ino:
            return descriptor
    except (BlockingIOError, FileNotFoundError):
        pass
    os.close(descriptor)
    return None


def _holder(folder: Path) -> str:
    with contextlib.suppress(OSError):
        return (folder / LOCK).read_text() or "unknown"
    return "unknown"


def is_locked(folder: Path) -> bool | None:
    """Return whether a process works in this folder; None if the file may not be read, or cannot be locked."""
    try:
        descriptor = open_own(folder / LOCK, os.O_RDONLY)
    except (FileNotFoundError, IrregularFileError):  # taken as not locked
        return False
    except PermissionError:
        return None
    try:
        return None if not _flock(descriptor, fcntl.LOCK_SH) else False
    except BlockingIOError:
        return True
    finally:
        os.close(descriptor)


def _flock(descriptor: int, operation: int) -> bool:
    """Lock a file without waiting; where the file system has no locks, warn once and return False.

    Raises:
        BlockingIOError: Another process holds the lock.
    """
    try:
        fcntl.flock(descriptor, operation | fcntl.LOCK_NB)
    except OSError as error:
        if error.errno not in NO_LOCKS:
            raise
        _warn_of_no_locks()
        return False
    return True


@functools.cache
def _warn_of_no_locks() -> None:
    logger.warning("The file system of the runs has no locks; never let two processes work on the same run there.")


def tidy(folder: Path) -> None:
    """Remove what a process that was killed left beside a finished record; do nothing while a process works there."""
    if (folder / CHECKPOINT).exists() or any(folder.glob(".*.*")):
        with contextlib.suppress(LockedError), lock(folder):
            (folder / CHECKPOINT).unlink(missing_ok=True)
            remove_leftovers(folder)


def remove_leftovers(folder: Path) -> None:
    """Remove the temporary files of a process that was killed while writing; the caller holds the lock."""
    for name in (RECORD, EPISODES, CHECKPOINT, WEIGHTS, SPEC, ERROR):
        for path in folder.glob(f".{name}.*"):
            path.unlink()
