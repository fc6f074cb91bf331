"""What a record says of the machine and the code it ran on."""

from __future__ import annotations

import re
import subprocess
import sys
from importlib import metadata
from pathlib import Path

import pytest

from sprl_bench import provenance


@pytest.fixture(autouse=True)
def _nothing_remembered() -> None:
    provenance.git_commit.cache_clear()


def test_versions_are_those_of_what_is_loaded() -> None:
    code = "import gymnasium; from sprl_bench.provenance import versions; print(*versions().items(), sep=chr(10))"
    text = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=120).stdout
    found = dict(re.findall(r"\('(.+?)', '(.+?)'\)", text))
    assert found["gymnasium"] == metadata.version("gymnasium")
    assert found["numpy"] == metadata.version("numpy")
    assert found["sprl-bench"] == metadata.version("sprl-bench")
    assert found["python"] == ".".join(map(str, sys.version_info[:3]))
    assert found["platform"].startswith("Linux")
    assert "torch" not in found
    assert "pandas" not in found


def test_the_commit_is_that_of_the_code() -> None:
    here = Path(provenance.__file__).parent
    head = subprocess.run(["git", "-C", here, "rev-parse", "HEAD"], capture_output=True, text=True, check=False)
    if head.returncode:
        pytest.skip("this is not a checkout")
    assert provenance.git_commit() in (head.stdout.strip(), f"{head.stdout.strip()}-dirty")


def test_code_outside_of_version_control_has_no_commit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(provenance, "__file__", str(tmp_path / "provenance.py"))
    assert provenance.git_commit() is None


def test_an_untracked_file_inside_of_a_repository_has_no_commit(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As where a wheel is installed into an environment within somebody's project."""
    subprocess.run(["git", "init", "-q", tmp_path], check=True)
    (tmp_path / "provenance.py").touch()
    monkeypatch.setattr(provenance, "__file__", str(tmp_path / "provenance.py"))
    assert provenance.git_commit() is None


def test_without_git_there_is_no_commit(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", "")
    assert provenance.git_commit() is None


def test_hardware_is_described() -> None:
    found = provenance.hardware()
    assert found.cpu
    assert found.cores >= 1
    assert found.memory_gib > 0.1
    assert found.gpu is None


def test_peak_memory_is_that_of_this_process_alone() -> None:
    """A process that is started by a large one must not report its parent's peak."""
    ballast = bytearray(400 << 20)
    assert provenance.peak_memory_mib() > 400
    code = "from sprl_bench import provenance; print(provenance.peak_memory_mib())"
    child = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=120)
    assert 10 < float(child.stdout) < 400
    assert ballast
