"""Runs that end in other ways: a cut checkpoint, a clock that is set, a full disk, several commands on one folder.

Each ends, at the latest when it is continued, in the files of an undisturbed run.
"""

from __future__ import annotations

import json
import os
import random
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import gymnasium
import pytest
from run_files import LASTING, files_of

import sprl_bench
from sprl_bench.checkpoint import BrokenCheckpointError, load
from sprl_bench.records import RunRecord, RunSpec, read
from sprl_bench.records.folder import CHECKPOINT, METRICS, RECORD
from sprl_bench.run import InterruptedRunError, run
from sprl_bench.suite import expand
from sprl_bench.tasks import find_suite


def spec(agent: str = "ppo", budget: int = 3_200) -> RunSpec:
    [one] = expand(find_suite("smoke"), [agent], [0], budget=budget)
    return one


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    out = tmp_path_factory.mktemp("whole")
    run(spec(), out)
    return files_of(out)


@pytest.fixture(scope="module")
def interrupted(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    """The files of a run that was stopped after its first update."""
    out = tmp_path_factory.mktemp("interrupted")
    with pytest.raises(InterruptedRunError):
        run(spec(), out, stop=lambda: True)
    return {path.name: path.read_bytes() for path in spec().path(out).iterdir()}


def lay(files: dict[str, bytes], out: Path) -> Path:
    folder = spec().path(out)
    folder.mkdir(parents=True)
    for name, content in files.items():
        (folder / name).write_bytes(content)
    return folder


def test_a_checkpoint_of_any_length_is_whole_or_broken(interrupted: dict[str, bytes], tmp_path: Path) -> None:
    content, path = interrupted[CHECKPOINT], tmp_path / CHECKPOINT
    generator = random.Random(0)
    lengths = {*range(16), *(generator.randrange(len(content)) for _ in range(200)), len(content) - 1}
    for length in sorted(lengths):
        path.write_bytes(content[:length])
        with pytest.raises(BrokenCheckpointError):
            load(path)
    path.write_bytes(content)
    assert load(path)["spec"]


@pytest.mark.parametrize("share", [0.3, 0.999])
def test_a_run_with_a_cut_checkpoint_ends_the_same(
    share: float, interrupted: dict[str, bytes], whole: dict[str, Any], tmp_path: Path
) -> None:
    content = interrupted[CHECKPOINT]
    lay({**interrupted, CHECKPOINT: content[: int(share * len(content))]}, tmp_path)
    run(spec(), tmp_path)
    assert files_of(tmp_path) == whole


CLOCKS: Final = ("time", "monotonic", "perf_counter")  # of these, only the sink of TensorBoard calls the first


def set_clocks(monkeypatch: pytest.MonkeyPatch, shift: int) -> dict[str, int]:
    """Let each clock jump after its second call; return how often each is called."""
    calls = dict.fromkeys(CLOCKS, 0)

    def jumping(name: str, clock: Callable[[], float]) -> Callable[[], float]:
        def now() -> float:
            calls[name] += 1
            return clock() + shift * (calls[name] > 2)

        return now

    for name in CLOCKS:
        monkeypatch.setattr(time, name, jumping(name, getattr(time, name)))
    return calls


@pytest.mark.parametrize("shift", [-(10**9), 10**9])
def test_a_clock_that_is_set_changes_nothing(
    shift: int, interrupted: dict[str, bytes], whole: dict[str, Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = lay(interrupted, tmp_path)
    for path in folder.iterdir():
        os.utime(path, (0, 0) if shift > 0 else (4 * 10**9, 4 * 10**9))
    calls = set_clocks(monkeypatch, shift)
    run(spec(), tmp_path)
    monkeypatch.undo()
    assert min(calls["monotonic"], calls["perf_counter"]) > 2
    assert read(folder / RECORD, RunRecord).wall_time_s >= 0
    lines = [json.loads(line) for line in (folder / METRICS).read_bytes().splitlines()]
    assert min(line["wall_time_s"] for line in lines) >= 0
    assert files_of(tmp_path) == whole


def test_a_clock_that_is_set_back_costs_no_recorded_script(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    env = gymnasium.make("sprl_bench:SPRL/FourRooms-7x7-v1")
    env = sprl_bench.record(env, out=tmp_path, agent="mine", seed=0, budget=50)
    clock = time.perf_counter
    monkeypatch.setattr(time, "perf_counter", lambda: clock() - 10**9)
    env.reset(seed=0)
    for _ in range(50):
        if any(env.step(0)[2:4]):
            env.reset()
    env.close()
    [record] = sprl_bench.find_records(tmp_path)
    assert (record.status, record.wall_time_s) == ("complete", 0.0)


COMMAND: Final = ["run", "--suite", "smoke", "--agents", "ppo,random", "--seeds", "1", "--budget", "3200", "--device"]
COMMAND.extend(["cpu", "--workers", "1", "--out"])


@pytest.mark.parametrize("processes", [2, 3])
def test_several_commands_on_one_folder_share_its_runs(processes: int, whole: dict[str, Any], tmp_path: Path) -> None:
    command = [sys.executable, "-m", "sprl_bench", *COMMAND, str(tmp_path / "runs")]
    started = [subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) for _ in range(processes)]
    ended = [(process.communicate(timeout=300)[1].decode(), process.returncode) for process in started]
    for said, status in ended:
        assert status == 0 or "is in use by another process" in said, said
        assert "Traceback" not in said
    assert subprocess.run(command, capture_output=True, check=False, timeout=300).returncode == 0
    there = files_of(tmp_path / "runs")
    assert {name: there[name] for name in whole} == whole
    assert {Path(name).name for name in there} <= LASTING


FULL: Final = """
import resource, signal, sys
from pathlib import Path
from sprl_bench.records import RunSpec
from sprl_bench.run import run
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[3]), resource.RLIM_INFINITY))
try:
    run(RunSpec.model_validate_json(sys.argv[1]), Path(sys.argv[2]), checkpoint_every_s=0)
except OSError as error:
    print(type(error).__name__, error.errno)
    sys.exit(3)
"""


@pytest.mark.parametrize("room", [0, 700, 50_000])
def test_a_disk_that_is_full_at_any_write_costs_no_result(room: int, whole: dict[str, Any], tmp_path: Path) -> None:
    """Files may not grow beyond `room` bytes: the spec, the metrics, the checkpoint, the episodes, the record."""
    command = [sys.executable, "-c", FULL, spec().model_dump_json(), str(tmp_path), str(room)]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=300)
    assert done.returncode == 3, done.stderr
    assert "OSError 27" in done.stdout
    left = {path.name for path in tmp_path.rglob("*") if path.is_file()}
    assert RECORD not in left
    assert not [name for name in left if name.startswith(".") and name != ".lock"]
    run(spec(), tmp_path)
    assert files_of(tmp_path) == whole
    assert read(spec().path(tmp_path) / RECORD, RunRecord).status == "complete"
