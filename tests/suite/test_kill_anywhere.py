"""A suite that is killed anywhere gives the files of one that was not, byte for byte, and leaves nothing else behind.

Two domains, tiny budgets. CI tries 12 moments with four agents; `SPRL_KILLS=200` tries as many as it says, with all.
"""

from __future__ import annotations

import contextlib
import os
import queue
import random
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Final

import psutil
from run_files import LASTING, files_of

from sprl_bench.records.folder import RECORD

KILLS: Final = int(os.environ.get("SPRL_KILLS", "12"))
SERVER: Final = """
import multiprocessing, os, signal, sys, tempfile, traceback
from pathlib import Path
from sprl_bench.executors import local, make_executor
from sprl_bench.run import run
from sprl_bench.suite import expand, run_suite
from sprl_bench.tasks import find_suite

MANY = int(os.environ.get("SPRL_KILLS", "12")) > 12
AGENTS = ("random,ppo,eco,sprl" + ",icm,rnd,count,gt-grid,gt-sprl" * MANY).split(",")
SPECS = [
    *expand(find_suite("smoke"), AGENTS, [0], budget=1_600),
    *expand(find_suite("fetch"), ["ppo"], [0], tasks=["FetchReach"], budget=1_600),
]

def work(out):
    os.setsid()
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        done = run_suite(SPECS, Path(out), executor=make_executor("local", 1), keep_actions=True)
    except KeyboardInterrupt:
        return 130
    except BaseException:
        traceback.print_exc()
        return 2
    return any(one.status == "failed" for one in done)

# Everything is loaded once, and each suite is forked from here with its workers, so that a start costs nothing.
with tempfile.TemporaryDirectory() as folder:
    for spec in SPECS:
        run(spec, Path(folder))
fork = multiprocessing.get_context("fork")
local.multiprocessing.get_context = lambda _: fork
print("ready", flush=True)
for line in sys.stdin:
    if (child := os.fork()) == 0:
        os._exit(work(line.strip()))
    print(child, flush=True)
    print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), flush=True)
"""


class Server:
    """Starts suites, each in a process group of its own."""

    def __init__(self, folder: Path) -> None:
        script = folder / "server.py"
        script.write_text(SERVER)
        self._process = subprocess.Popen(
            [sys.executable, script], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, bufsize=1
        )
        self._lines: queue.Queue[str] = queue.Queue()
        threading.Thread(target=self._read, daemon=True).start()
        assert self._lines.get(timeout=600) == "ready"

    def _read(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            self._lines.put(line.strip())

    def start(self, out: Path) -> int:
        """Start a suite, and return its process, which leads a group."""
        assert self._process.stdin is not None
        self._process.stdin.write(f"{out}\n")
        return int(self._lines.get(timeout=60))

    def wait(self, seconds: float) -> int | None:
        """Return the exit status of the suite; None if it has not ended within a while."""
        try:
            return int(self._lines.get(timeout=seconds))
        except queue.Empty:
            return None

    def close(self) -> None:
        self._process.kill()
        self._process.wait()
        for stream in (self._process.stdin, self._process.stdout):
            if stream is not None:
                stream.close()


def signal_it(suite: int, how: str, generator: random.Random) -> None:
    """Send one or two signals to the worker, the parent or the whole group."""
    whom, name, times = how.split()
    for _ in range(int(times)):
        with contextlib.suppress(ProcessLookupError, psutil.NoSuchProcess):
            if whom == "group":
                os.killpg(suite, signal.Signals[name])
            elif whom == "parent":
                os.kill(suite, signal.Signals[name])
            else:
                for child in psutil.Process(suite).children():
                    child.send_signal(signal.Signals[name])
        time.sleep(generator.uniform(0.0, 0.3))


HOW: Final = [
    f"{whom} {name} {times}"
    for name, times in (("SIGKILL", 1), ("SIGTERM", 1), ("SIGINT", 1), ("SIGINT", 2))
    for whom in ("group", "parent", "worker")
]


def wait_for_the_group(suite: int) -> None:
    """Wait until no process of a suite is left, as an orphan of a killed parent must end by itself."""
    deadline = time.monotonic() + 60
    while [one for one in psutil.process_iter(["status"]) if _is_of(one, suite)]:
        assert time.monotonic() < deadline, "a process of the suite goes on"
        time.sleep(0.1)


def _is_of(process: psutil.Process, suite: int) -> bool:
    with contextlib.suppress(ProcessLookupError):
        return os.getpgid(process.pid) == suite and process.info["status"] != psutil.STATUS_ZOMBIE
    return False


def test_a_suite_that_is_killed_anywhere_ends_in_the_same_files(tmp_path: Path) -> None:
    generator = random.Random(20)
    with contextlib.closing(Server(tmp_path)) as server:
        begun = time.monotonic()
        server.start(tmp_path / "whole")
        assert server.wait(600) == 0
        lasts = time.monotonic() - begun
        expected = files_of(tmp_path / "whole")
        assert {Path(name).name for name in expected} <= LASTING
        kills = chains = 0
        while kills < KILLS:
            out, tried = tmp_path / f"killed-{chains}", list[str]()
            chains += 1
            status: int | None = None
            while status != 0:
                suite = server.start(out)
                status = server.wait(generator.uniform(0.0, lasts / 3)) if kills < KILLS and len(tried) < 12 else None
                if status is None and kills < KILLS and len(tried) < 12:
                    tried.append(HOW[kills % len(HOW)])
                    signal_it(suite, tried[-1], generator)
                    kills += 1
                status = server.wait(600) if status is None else status
                assert status != 2, tried
                wait_for_the_group(suite)
            assert files_of(out) == expected, tried
    print(
        f"{kills} kills in {chains} suites of {len(list((tmp_path / 'whole').rglob(RECORD)))} runs: all files identical"
    )
