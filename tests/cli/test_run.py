"""The command line's `run`: seeds and settings are read, runs are made, and what goes wrong is one line."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from cli_calls import Capture, call, refused
from sprl_bench.cli.options import parse_seeds
from sprl_bench.naming import parse_settings
from sprl_bench.records import find_records
from sprl_bench.suite import devices


def test_seeds_are_a_number_or_a_list() -> None:
    assert parse_seeds("3") == [0, 1, 2]
    assert parse_seeds("3,") == [3]
    assert parse_seeds("0, 3,7") == [0, 3, 7]
    for text in ("", ",", "-1", "1.5", "0", "a", "1;2", "9" * 30, "10001"):
        with pytest.raises(ValueError, match="seeds is"):
            parse_seeds(text)


def test_settings_have_types_and_are_never_evaluated() -> None:
    settings = [
        "a=1",
        "b=1.5",
        "c=true",
        "d=null",
        "e=word",
        "f=[1, 2]",
        "g=",
        "h=x=y",
        'i="1"',
        "j=1e-4",
        "k=__import__('os')",
    ]
    assert parse_settings(settings) == {
        "a": 1,
        "b": 1.5,
        "c": True,
        "d": None,
        "e": "word",
        "f": [1, 2],
        "g": "",
        "h": "x=y",
        "i": "1",
        "j": 1e-4,
        "k": "__import__('os')",
    }
    for text in ("a=NaN", "a=-Infinity", "a=1e999", "a=[1, NaN]"):
        with pytest.raises(ValueError, match=r"--set a is .*; it must be finite"):
            parse_settings([text])
    for text in ("a=" + "[" * 100_000, "a=" + "9" * 5_000):
        with pytest.raises(ValueError, match=r"--set a is .*; it must be shorter"):
            parse_settings([text])
    with pytest.raises(ValueError, match="gives 'a' twice"):
        parse_settings(["a=1", "a=2"])
    with pytest.raises(ValueError, match="must be KEY=VALUE"):
        parse_settings(["=1"])


RUN = ["run", "--suite", "smoke", "--budget", "600", "--workers", "1", "--device", "cpu", "--set", "num_envs=3"]


def test_a_suite_from_the_command_to_the_table(capsys: Capture, tmp_path: Path, fakes: None) -> None:
    """One command trains, shows the table and tells what is next; again, it skips what is finished."""
    out = tmp_path / "my runs"
    command = [*RUN, "--agents", "random,harness_fakes:broken", "--seeds", "1", "--out", out]
    status, printed, err = call(capsys, *command)
    assert status == 1
    assert "random" in printed
    assert "broken † ‡" in printed
    assert "1 run is missing: FourRooms-7x7-600/broken/seed-0." in printed
    assert f"Records: {out}/custom/*/*/seed-*/record.json" in printed
    assert f"sprl-bench table '{out}'" in printed
    assert "seed-0: ZeroDivisionError: the agent divided by zero" in err
    assert "1 of 2 runs failed" in err
    assert "Traceback" not in err

    [record] = find_records(out)
    assert (record.spec.agent, record.spec.num_envs, record.totals.env_steps) == ("random", 3, 600)
    status, printed, _ = call(capsys, "status", out)
    assert status == 1
    assert printed.splitlines()[0].startswith("failed       custom/FourRooms-7x7-600/broken/seed-0  ")
    assert printed.splitlines()[-1] == "2 runs: 1 finished, 1 failed."

    before = (record.spec.path(out) / "record.json").stat().st_mtime_ns
    status, printed, err = call(capsys, *RUN, "--agents", "random", "--seeds", "1", "--out", out)
    assert status == 0
    assert "Mean AUC" in printed
    assert "skipped" in err
    assert (record.spec.path(out) / "record.json").stat().st_mtime_ns == before

    status, line = refused(capsys, *RUN[:-1], "num_envs=4", "--agents", "random", "--seeds", "2", "--out", out)
    assert (status, "num_envs: 3 on disk, 4 now" in line) == (1, True)


def test_a_gpu_that_is_not_here_is_refused_before_anything_is_written(
    capsys: Capture, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(devices, "_gpus", lambda: 0)
    command = ["run", "--suite", "smoke", "--agents", "random", "--device", "cuda", "--out", tmp_path / "runs"]
    assert refused(capsys, *command) == (2, "device is 'cuda'; it must be one that torch finds here: auto, cpu.")
    assert not (tmp_path / "runs").exists()


def test_a_suite_of_which_nothing_finished_offers_no_table(capsys: Capture, tmp_path: Path, fakes: None) -> None:
    command = [*RUN, "--agents", "harness_fakes:broken", "--seeds", "1", "--out", tmp_path]
    status, printed, err = call(capsys, *command)
    assert status == 1
    assert "1 of 1 runs failed" in err
    assert "Next:" not in printed
    assert "Mean AUC" not in printed


def test_an_agent_of_one_s_own_is_found_in_the_current_folder(tmp_path: Path) -> None:
    """Of a console script the interpreter puts the script's folder on the path, and not the current one."""
    (tmp_path / "my_own_agent.py").write_text(
        "import numpy\n"
        "class Still:\n"
        "    def train(self, envs, budget):\n"
        "        envs.reset()\n"
        "        while True:\n"
        "            envs.step(numpy.zeros(envs.num_envs, int))\n"
        "            yield {}\n"
        "def still(*, seed, device='cpu', width):\n"
        "    return Still()\n"
    )
    words = [
        *RUN,
        "--budget",
        "300",
        "--agents",
        "my_own_agent:still",
        "--seeds",
        "1",
        "--out",
        "runs",
        "--set",
        "width=3",
    ]
    script = Path(sys.executable).with_name("sprl-bench")
    assert script.exists(), "The project is not installed beside this interpreter."
    done = subprocess.run([script, *words], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert (done.returncode, "Traceback" in done.stderr) == (0, False), done.stderr
    [record] = find_records(tmp_path / "runs")
    assert (record.spec.agent, record.spec.hyperparameters, record.totals.env_steps) == ("still", {"width": 3}, 300)
