"""Starts suites of tiny runs without loading anything again; it is also the server: `python suite_server.py all`.

It reads lines "plain OUT INDEX,INDEX,..." or "first OUT INDEX,...": the runs of these indices into that folder, in an
ordinary process or in the first one of a PID namespace. It answers with the process, which leads a group, and later
with its exit status.
"""

from __future__ import annotations

import contextlib
import ctypes
import functools
import multiprocessing
import os
import queue
import signal
import subprocess
import sys
import tempfile
import threading
import traceback
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Final

from sprl_bench.executors import local, make_executor
from sprl_bench.records import RunSpec
from sprl_bench.run import run
from sprl_bench.suite import execute, expand, run_suite
from sprl_bench.tasks import find_suite

SMALL: Final = {"num_envs": 4, "rollout_length": 64}
# A network that is trained and in use after the first two rollouts.
NETWORK: Final = (
    "+replay_size=800+train_every=256+ready_trainings=1+ready_accuracy=0.0+max_pairs=400+pair_batch=16"
    "+accuracy_pairs=50+negative_bias=5"
)
BONUSES: Final = ("icm", "rnd", "gt-grid", f"eco{NETWORK}", f"sprl{NETWORK}")
CLONE_NEWNS, CLONE_NEWPID, MS_REC, MS_PRIVATE = 0x20000, 0x20000000, 0x4000, 0x40000


def specs(which: str) -> list[RunSpec]:
    """Return the runs: "few" of each agent once, ppo on Fetch and the others on a grid, or "all" agents on both."""
    on_grids = [*BONUSES, "count", "gt-sprl"]
    if which == "few":
        return [*_runs("smoke", ["random"], {}), *_runs("smoke", on_grids), *_runs("fetch", ["ppo"])]
    return [
        *_runs("smoke", ["random"], {}),
        *_runs("smoke", ["ppo", *on_grids]),
        *_runs("fetch", ["random"], {}),
        *_runs("fetch", ["ppo", *BONUSES]),
    ]


def _runs(suite: str, agents: Sequence[str], overrides: dict[str, int] = SMALL) -> list[RunSpec]:
    tasks = ["FetchReach"] if suite == "fetch" else None
    return expand(find_suite(suite), agents, [0], tasks=tasks, budget=800, overrides=overrides)


class Server:
    """Starts suites, each in a process group of its own."""

    def __init__(self, which: str) -> None:
        self._process = subprocess.Popen(
            [sys.executable, __file__, which], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, bufsize=1
        )
        self._lines: queue.Queue[str] = queue.Queue()
        threading.Thread(target=self._read, daemon=True).start()
        assert self._lines.get(timeout=900) == "ready"

    def _read(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            self._lines.put(line.strip())

    def start(self, out: Path, indices: Sequence[int], kind: str = "plain") -> int:
        """Start a suite, and return its process."""
        assert self._process.stdin is not None
        self._process.stdin.write(f"{kind} {out} {','.join(map(str, indices))}\n")
        return int(self._lines.get(timeout=60))

    def wait(self, seconds: float) -> int | None:
        """Return the exit status of the suite; None if it has not ended within a while."""
        try:
            return int(self._lines.get(timeout=seconds))
        except queue.Empty:
            return None

    def close(self) -> None:
        """End the server."""
        self._process.kill()
        self._process.wait()
        for stream in (self._process.stdin, self._process.stdout):
            if stream is not None:
                stream.close()


def serve(runs: Sequence[RunSpec]) -> None:
    """Load most once, then fork a suite for each line; its workers are forked too, so that a start costs little.

    They write a checkpoint after each update, so that kills meet half-written ones.
    """
    with tempfile.TemporaryDirectory() as folder:
        for spec in {spec.task.name: spec for spec in runs}.values():  # the last agent of each task
            run(spec, Path(folder))
    local.multiprocessing.get_context = lambda _: FORK  # type: ignore[assignment, attr-defined, misc]
    execute.run = functools.partial(run, checkpoint_every_s=0.0)  # type: ignore[assignment]
    print("ready", flush=True)
    for line in sys.stdin:
        kind, out, indices = line.split()
        chosen = [runs[int(index)] for index in indices.split(",")]
        with _started(functools.partial(_work, chosen, Path(out)), kind) as (suite, helper):
            print(suite, flush=True)
            print(os.waitstatus_to_exitcode(os.waitpid(helper, 0)[1]), flush=True)


FORK: Final[Any] = multiprocessing.get_context("fork")


@contextlib.contextmanager
def _started(work: Any, kind: str) -> Iterator[tuple[int, int]]:
    """Yield the suite's process and the one whose status is the suite's: the same, or its parent outside."""
    reader, writer = os.pipe()
    if (helper := os.fork()) == 0:
        os._exit(_as_first(work, writer) if kind == "first" else work())
    os.close(writer)
    with os.fdopen(reader) as said:
        yield (int(said.readline()) if kind == "first" else helper), helper


def _as_first(work: Any, writer: int) -> int:
    """Do the work in the first process of a new PID namespace, as in a container; return its status."""
    enter_namespace()
    if (suite := os.fork()) == 0:
        libc().mount(b"proc", b"/proc", b"proc", 0, None)
        os._exit(work())
    os.write(writer, f"{suite}\n".encode())
    return os.waitstatus_to_exitcode(os.waitpid(suite, 0)[1]) % 256


def libc() -> ctypes.CDLL:
    """Return the C library."""
    return ctypes.CDLL(None, use_errno=True)


def enter_namespace() -> None:
    """Let the next child be the first process of a PID namespace, with mounts of its own.

    Raises:
        PermissionError: This user may not.
    """
    if libc().unshare(CLONE_NEWPID | CLONE_NEWNS) or libc().mount(b"none", b"/", None, MS_REC | MS_PRIVATE, None):
        raise PermissionError(ctypes.get_errno(), "no namespaces of its own")


def namespaces_allowed() -> bool:
    """Return whether this user may make a PID namespace."""
    command = ["unshare", "--pid", "--fork", "--mount-proc", "true"]
    try:
        return subprocess.run(command, check=False, capture_output=True).returncode == 0
    except FileNotFoundError:
        return False


def _work(chosen: Sequence[RunSpec], out: Path) -> int:
    """Be the suite, with the handler of the command line; return its exit status."""
    os.setpgid(0, 0)
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        done = run_suite(chosen, out, executor=make_executor("local", 1), keep_actions=True)
    except KeyboardInterrupt:
        return 130
    except BaseException:
        traceback.print_exc()
        return 2
    return int(any(one.status == "failed" for one in done))


if __name__ == "__main__":
    serve(specs(sys.argv[1]))
