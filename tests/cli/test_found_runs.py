"""One broken run among others: it is named, and stops only what needs it."""

from __future__ import annotations

import html
import json
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from cli_calls import Capture, call, refused
from sprl_bench import records
from sprl_bench.records import RunRecord
from sprl_bench.records.folder import ERROR, LOCK, METRICS, RECORD, SPEC, lock

MakeRecord = Callable[..., RunRecord]


@pytest.fixture
def runs(grid_7x7: list[RunRecord], make_record: MakeRecord, tmp_path: Path) -> Path:
    """A finished suite, and a run of another one."""
    for run in [*grid_7x7, make_record()]:
        for name, content in ((SPEC, run.spec), (RECORD, run)):
            records.write(run.spec.path(tmp_path / "runs") / name, content)
    return tmp_path / "runs"


def titles(printed: str) -> list[str]:
    return [line for line in printed.splitlines() if line.startswith("Suite ")]


@pytest.mark.parametrize(
    ("name", "content"), [(RECORD, b""), (RECORD, b'{"no": "record"}'), (SPEC, b"\xff\xfe"), (SPEC, b"[" * 10_000)]
)
def test_a_broken_run_of_another_suite_stops_no_table(name: str, content: bytes, capsys: Capture, runs: Path) -> None:
    folder = runs / "smoke" / "FourRooms-7x7" / "ppo" / "seed-0"
    if name == SPEC:
        (folder / RECORD).unlink()
    (folder / name).write_bytes(content)
    status, printed, err = call(capsys, "table", runs)
    assert (status, titles(printed)) == (1, ["Suite grid-7x7, version 1"])
    assert err.startswith("sprl-bench: ")
    assert f"{folder}/{name}" in err
    assert "Traceback" not in err
    assert call(capsys, "table", runs, "--suite", "grid-7x7")[::2] == (0, "")
    status, printed, err = call(capsys, "table", runs, "--allow-missing")
    assert status == 0, err
    assert titles(printed)[0] == "Suite grid-7x7, version 1"
    assert name in printed + err


def test_a_broken_run_of_the_suite_itself_is_noted_below_its_table(capsys: Capture, runs: Path) -> None:
    folder = runs / "grid-7x7" / "FourRooms-7x7" / "ppo" / "seed-4"
    (folder / RECORD).write_text("{")
    status, printed, err = call(capsys, "table", runs)
    assert (status, titles(printed)) == (1, ["Suite smoke, version 2"])
    assert "--allow-missing" in err
    status, printed, _ = call(capsys, "table", runs, "--allow-missing", "--format", "md", "--suite", "grid-7x7")
    assert status == 0
    assert "1 run is missing: FourRooms-7x7/ppo/seed-4" in printed
    assert "1 run cannot be read." in printed.splitlines()[-1]
    assert f"{folder}/{RECORD}:1: " in printed


def test_the_report_counts_a_broken_run_as_the_table_does(
    capsys: Capture, runs: Path, make_record: MakeRecord, tmp_path: Path
) -> None:
    (runs / "grid-7x7" / "FourRooms-7x7" / "ppo" / "seed-4" / RECORD).write_text("{")
    failed = make_record("ppo", seed=5, suite="grid-7x7").spec
    records.write(failed.path(runs) / SPEC, failed)
    (failed.path(runs) / ERROR).write_text("ValueError: too early\n")
    chosen = ["--allow-missing", "--suite", "grid-7x7"]
    printed = call(capsys, "table", runs, *chosen, "--format", "md")[1]
    [drops] = [line for line in printed.splitlines() if "Drops: " in line]
    assert "1 failed (FourRooms-7x7/ppo/seed-5)" in drops
    assert drops.endswith("run cannot be read.")
    page = tmp_path / "report.html"
    status, _, err = call(capsys, "report", runs, "-o", page, "--allow-missing")
    assert status == 0, err
    text = html.unescape(page.read_text())
    assert drops.removeprefix("- ") in text
    assert "Drops: none; the table has the 1 planned run." in text  # of the other suite


def test_status_names_a_broken_run_beside_the_others(capsys: Capture, runs: Path) -> None:
    folder = runs / "grid-7x7" / "FourRooms-7x7" / "ppo" / "seed-4"
    (folder / RECORD).write_text("{")
    (runs / "grid-7x7" / "FourRooms-7x7" / "ppo" / "seed-3" / METRICS).write_bytes(b"\0" * 100)
    status, printed, err = call(capsys, "status", runs)
    assert (status, printed) == (1, "20 runs: 20 finished.\n")
    assert err.startswith(f"sprl-bench: {folder}/{RECORD}:1: ")
    assert err.count("\n") == 1


def test_run_goes_on_beside_a_broken_run(capsys: Capture, tmp_path: Path) -> None:
    broken = tmp_path / "custom" / "FourRooms-7x7-1000" / "random" / "seed-0"
    broken.mkdir(parents=True)
    (broken / RECORD).write_text("{")
    words = ["run", "--suite", "smoke", "--agents", "random", "--budget", "1000", "--seeds", "2", "--out", tmp_path]
    status, printed, err = call(capsys, *words)
    assert (status, "random" in printed) == (1, True), err
    assert f"{broken}/{RECORD}:1: " in err
    assert "1 of 2 runs failed" in err
    assert records.read(broken.parent / "seed-1" / RECORD, RunRecord).status == "complete"


def test_failed_trials_of_another_agent_stop_no_other_suite(
    capsys: Capture, runs: Path, make_record: MakeRecord
) -> None:
    for seed in range(6):
        spec = make_record("mine", seed=seed).spec
        records.write(spec.path(runs) / SPEC, spec)
        (spec.path(runs) / ERROR).write_text("ValueError: too early\n")
    status, printed, err = call(capsys, "table", runs)
    assert (status, titles(printed)) == (1, ["Suite grid-7x7, version 1"])
    assert err.count("\n") == 1
    assert "6 runs are missing: FourRooms-7x7/mine/seed-0" in err
    assert "remove the folders" in err
    for words in (["--suite", "grid-7x7"], ["--agent", "ppo", "--suite", "smoke"]):
        assert call(capsys, "table", runs, *words)[::2] == (0, ""), words
    status, line = refused(capsys, "table", runs, "--suite", "grid-7")
    assert (status, "did you mean 'grid-7x7'" in line) == (2, True)


def test_an_entry_needs_only_its_own_runs(capsys: Capture, runs: Path, tmp_path: Path) -> None:
    about = ["--author", "Ada", "--link", "https://example.org/a", "--home", tmp_path / "boards"]
    add = ["leaderboard", "add", runs, "--agent", "ppo", "--suite", "grid-7x7", *about]
    own, other = (runs / "grid-7x7" / "FourRooms-7x7" / agent / "seed-0" / RECORD for agent in ("ppo", "random"))
    sound = own.read_bytes()
    own.write_text("{")
    assert refused(capsys, *add)[1].startswith(f"{own}:1: ")
    own.write_bytes(sound)
    other.write_text("{")
    status, _, err = call(capsys, *add)
    assert (status, f"{other}:1: " in err) == (0, True), err


def test_a_picture_and_a_report_beside_a_broken_run(capsys: Capture, runs: Path, tmp_path: Path) -> None:
    broken = runs / "smoke" / "FourRooms-7x7" / "ppo" / "seed-0" / RECORD
    broken.write_text("{")
    picture = ["plot", runs, "-o", tmp_path / "curves.svg"]
    assert refused(capsys, *picture)[1].startswith(f"{broken}:1: ")
    assert not (tmp_path / "curves.svg").exists()
    assert call(capsys, *picture, "--suite", "grid-7x7")[0] == 0
    assert refused(capsys, "report", runs, "-o", tmp_path / "page.html")[1].startswith(f"{broken}:1: ")
    assert call(capsys, "report", runs, "-o", tmp_path / "page.html", "--allow-missing")[0] == 0
    assert f"Cannot be read: {broken}:1: " in (tmp_path / "page.html").read_text()


# --------------------------------------------------------------------------- folders that may be read alone

AS_A_READER = """
import contextlib, io, os, sys
from sprl_bench.cli import main
with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
    main(sys.argv[1:])  # loads all modules, which another user may not be able to
if os.geteuid() == 0:
    os.setuid(65534)
sys.exit(main(sys.argv[1:]))
"""


@pytest.fixture
def readable(runs: Path) -> Iterator[Path]:
    """The runs in a folder that any user may read, and only its owner may write."""
    with tempfile.TemporaryDirectory() as folder:
        Path(folder).chmod(0o755)
        shutil.copytree(runs, Path(folder, "runs"))
        yield Path(folder, "runs")
        set_modes(Path(folder), 0o755)


def set_modes(root: Path, mode: int) -> None:
    for folder, _, _ in os.walk(root):
        Path(folder).chmod(mode)


def read_as_another(*words: object) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-c", AS_A_READER, *map(str, words)]
    return subprocess.run(command, capture_output=True, text=True, check=False, timeout=120)


def test_a_folder_that_may_only_be_read_is_shown(readable: Path, make_record: MakeRecord) -> None:
    live = make_record(seed=1).spec
    folder = live.path(readable)
    records.write(folder / SPEC, live)
    (folder / METRICS).write_text('{"env_steps": 500, "wall_time_s": 1.0}\n')
    with lock(folder):
        set_modes(readable, 0o555)
        shown = read_as_another("status", readable)
        assert "running      smoke/FourRooms-7x7/ppo/seed-1" in shown.stdout, shown.stderr
        (folder / LOCK).chmod(0)
        shown = read_as_another("status", readable)
        assert "unknown      smoke/FourRooms-7x7/ppo/seed-1" in shown.stdout, shown.stderr
        shown = read_as_another("table", readable, "--suite", "grid-7x7", "--format", "json")
        assert (shown.returncode, len(json.loads(shown.stdout))) == (0, 1), shown.stderr
        set_modes(readable, 0o755)


def test_a_run_that_another_user_may_not_read_is_named(readable: Path) -> None:
    closed = readable / "smoke" / "FourRooms-7x7" / "ppo" / "seed-0"
    closed.chmod(0)
    shown = read_as_another("table", readable)
    assert (shown.returncode, titles(shown.stdout)) == (1, ["Suite grid-7x7, version 1"]), shown.stderr
    assert shown.stderr == f"sprl-bench: {closed}: Permission denied.\n"
