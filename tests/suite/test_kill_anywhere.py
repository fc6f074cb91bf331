"""A suite that is killed anywhere gives the files of one that was not, byte for byte, and leaves nothing else behind.

CI tries 12 moments, with each agent once: ppo on Fetch, the others on a grid. `SPRL_KILLS=200` tries as many as it
says, with all agents on both. Every other suite is the first process of a PID namespace, as in a container.
"""

from __future__ import annotations

import contextlib
import os
import random
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import psutil
import pytest
from run_files import LASTING, files_of
from suite_server import Server, namespaces_allowed, specs

from sprl_bench.leaderboard.reference_agents import PRIVILEGED
from sprl_bench.naming import AgentName
from sprl_bench.records import find_records
from sprl_bench.records.folder import CHECKPOINT, METRICS, RECORD

KILLS: Final = int(os.environ.get("SPRL_KILLS", "12"))
WHICH: Final = "few" if KILLS <= 12 else "all"
KILLS_A_SUITE: Final = {"few": 4, "all": 6}[WHICH]
RUNS_A_SUITE: Final = {"few": 3, "all": 4}[WHICH]
KINDS: Final = ("plain", "first") if namespaces_allowed() else ("plain",)
HOW: Final = [
    f"{whom} {name} {times}"
    for name, times in (("SIGKILL", 1), ("SIGTERM", 1), ("SIGINT", 1), ("SIGINT", 2))
    for whom in ("group", "parent", "worker")
]


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


class Killer:
    """Starts suites and kills them at random moments until they have been killed often enough.

    Args:
        server: Starts the suites.
        between_s: The most seconds from a start to a kill.

    Attributes:
        kills: Signals sent, one or two each.
    """

    def __init__(self, server: Server, between_s: float) -> None:
        self._server, self._generator, self._between_s = server, random.Random(20), between_s
        self.kills = 0

    def finish(self, out: Path, indices: list[int], kind: str) -> list[str]:
        """Start the suite again and again until it has finished; return how it was killed."""
        tried: list[str] = []
        while True:
            suite = self._server.start(out, indices, kind)
            status = self._finished_or_killed(suite, tried)
            assert status != 2, tried
            wait_for_the_group(suite)
            if status == 0:
                return tried

    def _finished_or_killed(self, suite: int, tried: list[str]) -> int | None:
        """Return the exit status of a suite, which gets signals at random moments until it ends, or has had enough."""
        while self.kills < KILLS and len(tried) < KILLS_A_SUITE:
            status = self._server.wait(self._generator.uniform(0.0, self._between_s))
            if status is not None:
                return status
            tried.append(HOW[self.kills % len(HOW)])
            self.kills += 1
            signal_it(suite, tried[-1], self._generator)
        return self._server.wait(600)


def decks(generator: random.Random) -> Iterator[list[int]]:
    """Yield the runs of each suite: over all suites each run comes equally often."""
    left: list[int] = []
    while True:
        while len(left) < RUNS_A_SUITE:
            left += generator.sample(range(len(specs(WHICH))), len(specs(WHICH)))
        yield sorted(set(left[:RUNS_A_SUITE]))
        left = left[RUNS_A_SUITE:]


def files_of_runs(expected: dict[str, Any], indices: list[int]) -> dict[str, Any]:
    """Return the files of some of the runs."""
    places = tuple(f"{specs(WHICH)[index].path(Path())}/" for index in indices)
    return {name: content for name, content in expected.items() if name.startswith(places)}


def typical_seconds(out: Path) -> float:
    """Return the time of a quick run: a quarter of them are quicker."""
    times = sorted(record.wall_time_s for record in find_records(out))
    return times[len(times) // 4]


@pytest.mark.parametrize("which", ["few", "all"])
def test_every_reference_agent_is_killed(which: str) -> None:
    assert {AgentName.parse(one.agent).source for one in specs(which)} == set(PRIVILEGED)


def test_a_suite_that_is_killed_anywhere_ends_in_the_same_files(tmp_path: Path) -> None:
    with contextlib.closing(Server(WHICH)) as server:
        everything = list(range(len(specs(WHICH))))
        server.start(tmp_path / "whole", everything)
        assert server.wait(900) == 0
        expected = files_of(tmp_path / "whole")
        assert {Path(name).name for name in expected} <= LASTING
        assert len(files_of_runs(expected, everything)) == len(expected)
        dealt: set[int] = set()
        killer = Killer(server, between_s=typical_seconds(tmp_path / "whole"))
        for number, indices in enumerate(decks(random.Random(0))):
            out = tmp_path / f"killed-{number}"
            tried = killer.finish(out, indices, KINDS[number % len(KINDS)])
            dealt.update(indices)
            assert files_of(out) == files_of_runs(expected, indices), tried
            print(f"{killer.kills} kills in {number + 1} suites: all files identical", flush=True)
            if killer.kills >= KILLS:
                break
        if len(everything) * KILLS_A_SUITE <= KILLS * RUNS_A_SUITE:
            assert dealt == set(everything)


# --------------------------------------------------------------------------- the command as PID 1


COMMAND: Final = ["unshare", "--pid", "--fork", "--mount-proc", "--kill-child", sys.executable, "-m", "sprl_bench"]
WORDS: Final = ["run", "--suite", "smoke", "--agents", "ppo", "--seeds", "1", "--budget", "12000", "--device", "cpu"]


def started(out: Path) -> tuple[subprocess.Popen[str], psutil.Process]:
    """Start the command as PID 1; return the process outside and the one inside, once it trains."""
    before = sum(path.stat().st_size for path in out.rglob(METRICS))
    command = subprocess.Popen([*COMMAND, *WORDS, "--out", str(out)], stderr=subprocess.PIPE, text=True)
    deadline = time.monotonic() + 180
    while sum(path.stat().st_size for path in out.rglob(METRICS)) <= before:
        assert command.poll() is None, command.communicate()
        assert time.monotonic() < deadline
        time.sleep(0.05)
    return command, psutil.Process(command.pid).children()[0]


@pytest.mark.skipif(len(KINDS) == 1, reason="this user may not make a PID namespace")
def test_the_first_process_of_a_container_saves_and_continues(tmp_path: Path) -> None:
    out = tmp_path / "runs"
    for name in ("SIGTERM", "SIGINT"):
        command, first = started(out)
        first.send_signal(signal.Signals[name])
        said = command.communicate(timeout=120)[1]
        assert command.returncode == 130, said
        assert said.splitlines()[-1] == "sprl-bench: Interrupted; the same command continues from here."
        assert list(out.rglob(CHECKPOINT))
    done = subprocess.run([*COMMAND, *WORDS, "--out", str(out)], capture_output=True, check=False, timeout=300)
    assert done.returncode == 0, done.stderr
    whole = [sys.executable, "-m", "sprl_bench", *WORDS, "--out", str(tmp_path / "whole")]
    assert subprocess.run(whole, capture_output=True, check=False, timeout=300).returncode == 0
    assert list(out.rglob(RECORD))
    assert files_of(out) == files_of(tmp_path / "whole")
