"""A run's folder: its path, the names of its files, and the lock that lets one process at a time write there."""

from __future__ import annotations

import contextlib
import fcntl
import os
import socket
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Final

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

PATIENCE_S: Final = 0.5  # `is_locked` takes the lock for a moment


def run_path(suite: str, task: str, agent: str, seed: int | str) -> Path:
    """Return a run's folder, relative to the root of all runs; each part may be a pattern such as "*"."""
    return Path(suite, task, agent, f"seed-{seed}")


def seeds_beside(folder: Path) -> list[Path]:
    """Return the folders of all seeds of a run's suite, task and agent, its own included."""
    return sorted(folder.parent.glob(run_path("", "", "", "*").name))


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
        yield
    finally:
        (folder / LOCK).unlink(missing_ok=True)
        os.close(descriptor)


def _acquire(folder: Path) -> int:
    folder.mkdir(parents=True, exist_ok=True)
    deadline = time.monotonic() + PATIENCE_S
    while (descriptor := _try(folder / LOCK)) is None:
        if time.monotonic() > deadline:
            raise LockedError(f"{folder} is in use by another process ({_holder(folder)}).")
        time.sleep(0.02)
    os.ftruncate(descriptor, 0)
    os.write(descriptor, f"process {os.getpid()} on {socket.gethostname()}".encode())
    return descriptor


def _try(path: Path) -> int | None:
    """Return an open, locked file, or None if another process holds the lock."""
    descriptor = os.open(path, os.O_RDWR | os.O_CREAT, 0o666)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
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


def is_locked(folder: Path) -> bool:
    """Return whether a process works in this folder."""
    try:
        descriptor = os.open(folder / LOCK, os.O_RDWR)
    except FileNotFoundError:
        return False
    try:
        fcntl.flock(descriptor, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    finally:
        os.close(descriptor)
    return False


def remove_leftovers(folder: Path) -> None:
    """Remove the temporary files of a process that was killed while writing; the caller holds the lock."""
    for name in (RECORD, EPISODES, CHECKPOINT, WEIGHTS, SPEC):
        for path in folder.glob(f".{name}.*"):
            path.unlink()
