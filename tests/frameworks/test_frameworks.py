"""What the pages of docs/frameworks say can be done: each script trains, and its runs are replayed equal, step by step.

Frameworks that need an environment of their own are skipped; `make frameworks` makes one for each and runs them there.
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from pages import ROOT, blocks_of, pages, words_of

from sprl_bench.records import find_records

HERE = {"cleanrl", "gymnasium", "stable-baselines3"}  # what they need is installed for other tests too
ELSEWHERE = {"minari", "rllib", "skrl", "tianshou", "torchrl"}
TASKS = {"FourRooms-7x7", "FetchReach"}
COMMAND = [sys.executable, "-m", "sprl_bench"]


def run(words: list[str], folder: Path) -> str:
    done = subprocess.run(
        words,
        check=False,
        cwd=folder,
        env={**os.environ, "MINARI_DATASETS_PATH": str(folder / "minari")},
        capture_output=True,
        text=True,
        timeout=500,
    )
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-4000:]
    return done.stdout


@pytest.mark.parametrize("name", sorted(HERE | ELSEWHERE))
def test_the_script_of_a_page_trains_and_is_scored(name: str, tmp_path: Path) -> None:
    if os.environ.get("SPRL_FRAMEWORK") != ("here" if name in HERE else name):
        pytest.skip("make frameworks runs this")
    script = next(block for block in blocks_of(f"docs/frameworks/{name}.md") if block.language == "python")
    (tmp_path / "script.py").write_text(script.code)
    run([sys.executable, "script.py"], tmp_path)
    records = find_records(tmp_path / "runs")
    assert {one.spec.task.name.rpartition("-")[0] for one in records} == TASKS
    assert {one.status for one in records} == {"complete"}
    assert all(one.totals.episodes > 10 for one in records)
    assert f"{len(records)} of {len(records)} runs are replayed equal." in run([*COMMAND, "verify", "runs"], tmp_path)


def test_an_agent_of_stable_baselines3_runs_on_the_command_line(tmp_path: Path) -> None:
    pytest.importorskip("stable_baselines3")
    agent = [block for block in blocks_of("docs/frameworks/stable-baselines3.md") if block.language == "python"][-1]
    (tmp_path / "my_sb3.py").write_text(agent.code)
    words = ["run", "--suite", "smoke", "--agents", "my_sb3:Learner", "--seeds", "1", "--budget", "3000"]
    run([*COMMAND, *words, "--device", "cpu", "--out", "runs"], tmp_path)
    assert [one.status for one in find_records(tmp_path / "runs")] == ["complete"]


def test_every_page_has_a_test_and_every_framework_a_page() -> None:
    names = {Path(page).stem for page in pages(("docs/frameworks/*.md",))}
    assert names - {"README"} == HERE | ELSEWHERE
    assert all(f"({name}.md)" in (ROOT / "docs/frameworks/README.md").read_text() for name in HERE | ELSEWHERE)


@pytest.mark.parametrize("page", pages(("docs/frameworks/*.md",)))
def test_a_page_is_short(page: str) -> None:
    assert words_of(page) < 450
