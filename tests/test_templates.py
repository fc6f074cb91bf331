"""The templates: each is a package that can be installed, its agent runs, and an interrupted run continues exactly."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from run_files import files_of

from sprl_bench.records import find_records
from sprl_bench.records.folder import METRICS

TEMPLATES = Path(__file__).parents[1] / "templates"
NAMES = {"bonus": "seen", "agent": "q-learning"}


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """Return the variables of a process that finds both packages."""
    site = tmp_path_factory.mktemp("site")
    words = ["--quiet", "--no-deps", "--no-build-isolation", "--disable-pip-version-check", "--target", str(site)]
    folders = [str(TEMPLATES / name) for name in NAMES]
    subprocess.run([sys.executable, "-m", "pip", "install", *words, *folders], check=True, timeout=200)
    return {**os.environ, "PYTHONPATH": os.pathsep.join([str(site), os.environ.get("PYTHONPATH", "")])}


def start(agent: str, out: Path, environment: dict[str, str], *words: str) -> subprocess.Popen[bytes]:
    command = [sys.executable, "-m", "sprl_bench", "run", "--suite", "smoke", "--agents", agent, "--seeds", "1"]
    return subprocess.Popen([*command, "--device", "cpu", "--out", str(out), *words], env=environment)


@pytest.mark.parametrize(("template", "agent"), NAMES.items())
def test_a_template_runs_and_continues(template: str, agent: str, installed: dict[str, str], tmp_path: Path) -> None:
    words = ["--budget", "12000", "--set", "num_envs=4"]
    assert start(agent, tmp_path / "whole", installed, *words).wait(200) == 0
    halves = start(agent, tmp_path / "halves", installed, *words)
    while not any(path.stat().st_size for path in (tmp_path / "halves").rglob(METRICS)) and halves.poll() is None:
        time.sleep(0.02)
    halves.send_signal(signal.SIGINT)
    assert halves.wait(60) == 130
    assert start(agent, tmp_path / "halves", installed, *words).wait(200) == 0
    assert files_of(tmp_path / "halves") == files_of(tmp_path / "whole")
    [record] = find_records(tmp_path / "whole")
    assert record.totals.episodes > 50


@pytest.mark.parametrize("template", NAMES)
def test_a_template_is_short(template: str) -> None:
    files = [path for path in (TEMPLATES / template).iterdir() if path.suffix in (".py", ".toml")]
    assert len(files) == 2
    assert sum(len(path.read_text().splitlines()) for path in files) <= 80
