"""The doctor: what is installed, what works, and what would not compare."""

from __future__ import annotations

import json
import re
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from sprl_bench import shipped
from sprl_bench.cli import main
from sprl_bench.doctor import examine, pinned_versions, probes
from sprl_bench.envs.maze import maze_bank

Capture = pytest.CaptureFixture[str]
SOUND: dict[str, dict[str, Any]] = {
    "computing": {"device": "cpu"},
    "joints": {"broken": True, "mended": True},
    "drawing": {"backend": "egl", "driver": "llvmpipe", "shape": [480, 480], "seconds": 0.04},
}


@pytest.fixture(autouse=True)
def answers(monkeypatch: pytest.MonkeyPatch) -> dict[str, dict[str, Any]]:
    """Give the doctor made-up answers, which a test may change; those of this machine take seconds."""
    made = dict(SOUND)
    monkeypatch.setattr(probes, "probe", lambda: made)
    monkeypatch.delenv("MUJOCO_GL", raising=False)
    return made


def call(capsys: Capture) -> tuple[int, str]:
    status = main(["doctor"])
    out, err = capsys.readouterr()
    assert err == ""
    return status, " ".join(out.replace("\n", "|").split())


def test_the_doctor_tells_what_would_not_compare(capsys: Capture, monkeypatch: pytest.MonkeyPatch) -> None:
    pins = pinned_versions()
    assert {"gymnasium", "minigrid", "numba", "numpy", "torch"} <= pins.keys()
    assert {finding.subject for finding in examine()} >= {"python", "numpy", "torch", "[baselines]", "[plots]"}
    monkeypatch.setattr("sprl_bench.doctor.findings.pinned_versions", lambda: {**pins, "numpy": "0.1"})
    status, out = call(capsys)
    assert status == 0
    assert "! numpy" in out
    assert "scored runs use 0.1" in out
    assert "may not compare with published ones: numpy" in out


def test_the_doctor_knows_the_layouts_of_the_mazes(capsys: Capture, monkeypatch: pytest.MonkeyPatch) -> None:
    assert "mazes 10,000 layouts of each level, as in scored runs" in call(capsys)[1]
    monkeypatch.setattr(maze_bank, "_DIGEST", "")
    assert "! mazes other layouts than in scored runs" in call(capsys)[1]


def test_the_doctor_cannot_tell_without_pins(capsys: Capture, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(shipped, "__file__", str(tmp_path / "sprl_bench" / "shipped.py"))
    assert pinned_versions() == {}
    status, out = call(capsys)
    assert status == 0
    assert "? numpy" in out
    assert re.search(r"No pinned version to compare with \(constraints.txt\): (ale-py, )?gymnasium, ", out)
    assert "compare with published ones" not in out
    (tmp_path / "sprl_bench").mkdir()
    (tmp_path / "sprl_bench" / "_constraints.txt").write_text("numpy==0.1\n")
    assert pinned_versions() == {"numpy": "0.1"}
    _, out = call(capsys)
    assert "! numpy" in out


def test_the_doctor_tells_what_works(capsys: Capture, answers: dict[str, dict[str, Any]]) -> None:
    status, out = call(capsys)
    assert status == 0
    assert "| device --device auto means cpu|" in out
    assert "| joints gymnasium-robotics cannot read them under this mujoco; our fix is in force|" in out
    assert "| rendering works: 480x480 in 40 ms through egl on llvmpipe|" in out
    assert f"| mujoco {pinned_versions()['mujoco']}, as in scored runs|" in out
    assert "torch uses 1 in each run|" in out
    assert "Does not work" not in out
    answers["joints"] = {"broken": False, "mended": True}
    assert "our fix is not in force|" in call(capsys)[1]


def test_the_doctor_says_what_to_do_where_pictures_cannot_be_drawn(
    capsys: Capture, answers: dict[str, dict[str, Any]], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("MUJOCO_GL", "glfw")
    answers["drawing"] = {"trouble": "FatalError: no\ncontext"}
    answers["joints"] = {"broken": True, "mended": False}
    status, out = call(capsys)
    assert status == 0
    assert "|x rendering does not work with MUJOCO_GL=glfw (FatalError: no context); training needs no pictures." in out
    assert "libegl1" in out
    assert "|x joints gymnasium-robotics cannot read them under this mujoco, even mended|" in out
    assert "|Does not work here: joints, rendering.|" in out


def test_what_is_not_installed_is_not_tried(capsys: Capture, answers: dict[str, dict[str, Any]]) -> None:
    answers.clear()
    status, out = call(capsys)
    assert (status, "rendering" in out, "device" in out) == (0, False, False)


def test_the_probes_answer_on_this_machine() -> None:
    """Another process's answers, with what libraries print left out."""
    pytest.importorskip("mujoco")
    pytest.importorskip("gymnasium_robotics")
    pytest.importorskip("torch")
    command = [sys.executable, "-m", "sprl_bench.doctor.probes"]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    found = probes._parse(f"a banner\n{done.stdout}")
    assert found.keys() == SOUND.keys()
    assert all(found[name].keys() == answer.keys() for name, answer in SOUND.items()), found
    assert found["joints"]["mended"] is True
    assert found["drawing"]["backend"] in ("glfw", "egl", "osmesa")


def test_a_driver_that_ends_its_process_leaves_the_doctor_standing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.undo()  # the true `probe`
    first = json.dumps({"probe": "computing", "device": "cpu"})
    code = f"import os, signal; print({first!r}, flush=True); os.kill(os.getpid(), signal.SIGSEGV)"
    true_run = subprocess.run
    monkeypatch.setattr(subprocess, "run", lambda _, **how: true_run([sys.executable, "-c", code], **how))
    monkeypatch.setattr(probes, "_possible", lambda: list(SOUND))
    trouble = {"trouble": f"the process that tried it ended with status {-signal.SIGSEGV}"}
    assert probes.probe() == {"computing": {"device": "cpu"}, "joints": trouble, "drawing": trouble}
    monkeypatch.setattr(probes, "PATIENCE_S", 0.0)
    assert probes.probe() == {name: {"trouble": "no answer within 0 s"} for name in SOUND}


def test_a_probe_that_fails_says_why(capsys: Capture, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail() -> dict[str, Any]:
        raise RuntimeError("no crayons")

    monkeypatch.setattr(probes, "PROBES", {"joints": ((), lambda: {"broken": False}), "drawing": (("os",), fail)})
    probes.main()
    assert probes._parse(capsys.readouterr().out) == {
        "joints": {"broken": False},
        "drawing": {"trouble": "RuntimeError: no crayons"},
    }
    monkeypatch.setattr(probes, "PROBES", {"drawing": (("no_such_module",), fail)})
    probes.main()
    assert capsys.readouterr().out == ""
