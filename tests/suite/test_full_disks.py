"""A disk that is full at any write of a run, and a folder that may not be written to.

The disk is a real one, of memory, mounted in a namespace of the process alone.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any, Final

import pytest
from run_files import files_of

from sprl_bench.records import RunSpec
from sprl_bench.records.folder import ACTIONS, CHECKPOINT, EPISODES, LOCK, METRICS, RECORD, SPEC, WEIGHTS
from sprl_bench.run import run
from sprl_bench.suite import expand
from sprl_bench.tasks import find_suite


def on_a_disk(options: str, folder: Path, *command: str) -> subprocess.CompletedProcess[str]:
    """Run a command that alone sees a new disk of memory at a folder."""
    mount = f'mount -t tmpfs -o {options} tmpfs "$1" && shift && exec "$@"'
    words = ["unshare", "--user", "--map-root-user", "--mount", "sh", "-c", mount, "sh", str(folder), *command]
    return subprocess.run(words, capture_output=True, text=True, check=False, timeout=300)


def disks_allowed() -> bool:
    """Return whether this user may mount a disk."""
    try:
        return on_a_disk("size=1m", Path("/mnt"), "true").returncode == 0
    except FileNotFoundError:  # no unshare on this system
        return False


needs_disks = pytest.mark.skipif(not disks_allowed(), reason="this user may not mount a disk of memory")


def spec() -> RunSpec:
    [one] = expand(find_suite("smoke"), ["ppo"], [0], budget=3_200, device="cpu")
    return one


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    out = tmp_path_factory.mktemp("whole")
    run(spec(), out, keep_actions=True)
    return files_of(out)


FULL: Final = """
import contextlib, shutil, sys
from pathlib import Path
from sprl_bench.records import RunSpec, files, folder
from sprl_bench.recorder import tape
import sprl_bench.run
runs = sys.modules['sprl_bench.run']

text, disk, kept, full_at, number = sys.argv[1:]
spec, out, filler, calls = RunSpec.model_validate_json(text), Path(disk, "runs"), Path(disk, "filler"), []

def fill():
    with filler.open("wb", buffering=0) as file:
        for size in (1 << 20, 1 << 12, 1):
            with contextlib.suppress(OSError):
                while file.write(b"x" * size) == size: pass

def filling(function, name_of):
    def call(*arguments):
        calls.append(name_of(*arguments))
        if calls.count(full_at) == int(number) and calls[-1] == full_at: fill()
        return function(*arguments)
    return call

files._replace = filling(files._replace, lambda path, content: path.name)
folder.os.ftruncate = filling(folder.os.ftruncate, lambda *_: ".lock")
runs._ActiveRun.report = filling(runs._ActiveRun.report, lambda *_: "metrics.jsonl")
tape.Tape.flush = filling(tape.Tape.flush, lambda *_: "actions.tape")
try:
    runs.run(spec, out, checkpoint_every_s=0, keep_actions=True)
except OSError as error:
    print(error.errno, sorted(path.name for path in out.rglob("*") if path.is_file()))
    full_at = ""
    filler.unlink()
    runs.run(spec, out, checkpoint_every_s=0, keep_actions=True)
    shutil.copytree(out, kept)
"""


@needs_disks
@pytest.mark.parametrize(
    ("name", "number"),
    [(CHECKPOINT, 2), *((name, 1) for name in (LOCK, SPEC, METRICS, ACTIONS, CHECKPOINT, WEIGHTS, EPISODES, RECORD))],
)
def test_a_run_goes_on_once_a_full_disk_has_room(name: str, number: int, whole: dict[str, Any], tmp_path: Path) -> None:
    disk, kept = tmp_path / "disk", tmp_path / "kept"
    disk.mkdir()
    words = [spec().model_dump_json(), str(disk), str(kept), name, str(number)]
    done = on_a_disk("size=32m", disk, sys.executable, "-c", FULL, *words)
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("28 "), done.stdout
    left = done.stdout.splitlines()[0]
    assert RECORD not in left
    assert not [one for one in (SPEC, CHECKPOINT, WEIGHTS, EPISODES) if f".{one}." in left]
    assert files_of(kept) == whole


RUN: Final = ["run", "--suite", "smoke", "--agents", "random", "--seeds", "1", "--budget", "500", "--workers", "1"]


@needs_disks
def test_a_disk_that_is_read_only_is_named_in_one_sentence(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "sprl_bench", *RUN, "--out", str(tmp_path / "runs")]
    done = on_a_disk("ro,size=1m", tmp_path, *command)
    assert done.returncode == 1
    assert "Traceback" not in done.stdout + done.stderr
    said = [line for line in done.stderr.splitlines() if "Read-only file system" in line]
    assert said[-1].startswith("sprl-bench: ")
    assert str(tmp_path) in said[-1]
    assert "1 of 1 runs failed" in done.stderr
    assert not list(tmp_path.iterdir())


@needs_disks
def test_a_folder_without_permission_is_named_in_one_sentence(tmp_path: Path) -> None:
    (tmp_path / "runs").mkdir()
    (tmp_path / "runs").chmod(0o555)
    nobody = ["unshare", "--user"]  # a user without root's privileges, and the owner of the folder
    command = [*nobody, sys.executable, "-m", "sprl_bench", *RUN, "--out", str(tmp_path / "runs")]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=300)
    assert done.returncode == 1
    assert "Traceback" not in done.stdout + done.stderr
    said = [line for line in done.stderr.splitlines() if "Permission denied" in line]
    assert said[-1].startswith("sprl-bench: ")
    assert str(tmp_path / "runs") in said[-1]
    assert not list((tmp_path / "runs").iterdir())
