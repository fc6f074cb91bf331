"""What becomes of a command whose output nobody can read: the work decides its status."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from sprl_bench import records
from sprl_bench.cli.streams import ASCII, legible
from sprl_bench.records import RunRecord
from sprl_bench.records.folder import RECORD
from sprl_bench.tables.render import BLOCKS, PARTIAL, PRIVILEGED

WORDS = ["run", "--suite", "smoke", "--agents", "random", "--budget", "1000", "--seeds", "1", "--out"]


def shell(line: str, *, encoding: str = "utf-8") -> subprocess.CompletedProcess[bytes]:
    environment = {**os.environ, "PYTHONIOENCODING": encoding, "SB": f"{sys.executable} -m sprl_bench"}
    return subprocess.run(["bash", "-c", line], capture_output=True, check=False, env=environment, timeout=120)


@pytest.mark.parametrize(
    "end",
    [
        ">&-",
        "2>&-",
        "<&- >&- 2>&-",
        "2>&1 | true; exit ${PIPESTATUS[0]}",
        "> /dev/full 2> /dev/full",
    ],
)
def test_output_that_nobody_reads_does_not_stop_the_work(end: str, tmp_path: Path) -> None:
    done = shell(f"$SB {' '.join(WORDS)} {tmp_path} {end}")
    assert done.returncode == 0, done.stderr
    assert b"Traceback" not in done.stdout + done.stderr
    [record] = records.find_records(tmp_path)
    assert record.status == "complete"


def test_a_failed_run_has_its_status_without_output(tmp_path: Path) -> None:
    broken = tmp_path / "custom" / "FourRooms-7x7-1000" / "random" / "seed-0"
    broken.mkdir(parents=True)
    (broken / RECORD).write_text("{")
    assert shell(f"$SB {' '.join(WORDS)} {tmp_path} >&- 2>&-").returncode == 1


@pytest.fixture
def one_run(make_record: Callable[..., RunRecord], tmp_path: Path) -> Path:
    run = make_record(privileged=True)
    records.write(run.spec.path(tmp_path) / RECORD, run)
    return tmp_path


@pytest.mark.parametrize("encoding", ["ascii", "latin-1", "ascii:strict"])
def test_a_table_on_a_terminal_without_unicode(encoding: str, one_run: Path) -> None:
    done = shell(f"$SB table {one_run}", encoding=encoding)
    assert done.returncode == 0, done.stderr
    shown = done.stdout.decode("ascii")
    assert " ------" in shown
    assert "ppo +" in shown
    assert "+ privileged: sees" in shown
    assert "?" not in shown


def test_a_table_that_cannot_be_written_is_an_error(one_run: Path) -> None:
    done = shell(f"$SB table {one_run} > /dev/full")
    assert (done.returncode, done.stderr) == (1, b"sprl-bench: [Errno 28] No space left on device\n")


def test_each_letter_of_a_table_has_one_in_ascii() -> None:
    text = BLOCKS + PRIVILEGED + PARTIAL
    assert text.translate(ASCII).isascii()
    assert len(text.translate(ASCII)) == len(text)
    assert legible(text, "utf-8") == text
    assert legible("é", "latin-1") == "é"
