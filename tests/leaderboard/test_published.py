"""The entries that are published here: valid, of the environments as they stand, and what comes out again."""

from __future__ import annotations

from pathlib import Path

import pytest

from sprl_bench import leaderboard
from sprl_bench.leaderboard import Entry
from sprl_bench.recorder.fingerprint import fingerprint
from sprl_bench.run import run
from sprl_bench.suite import expand
from sprl_bench.tasks import find_suite

BOARDS = Path(__file__).parents[2] / "leaderboards"
PATHS = sorted(BOARDS.glob("*/*.json"))
REFERENCE = {"random", "ppo", "icm", "gt-grid", "eco", "sprl", "gt-sprl"}


def test_every_reference_agent_is_published() -> None:
    assert {path.stem for path in PATHS if path.parent.name == "grid-7x7"} >= REFERENCE


def test_every_published_entry_is_valid() -> None:
    assert leaderboard.validate(PATHS) == []
    assert [len(table.rows) for table in leaderboard.boards(BOARDS)] == [len(PATHS)]


@pytest.mark.parametrize("path", PATHS, ids=lambda path: f"{path.parent.name}/{path.stem}")
def test_it_is_of_the_environments_as_they_stand(path: Path) -> None:
    entry = leaderboard.read_entry(path)
    assert [part.fingerprint for part in entry.tasks] == [fingerprint(part.task) for part in entry.tasks]


@pytest.mark.parametrize("path", PATHS, ids=lambda path: f"{path.parent.name}/{path.stem}")
def test_it_is_of_a_build_that_a_commit_names(path: Path) -> None:
    entry: Entry = leaderboard.read_entry(path)
    assert entry.git_commits
    assert not [commit for commit in entry.git_commits if not commit.isalnum()]


def test_the_random_agents_run_comes_out_again(tmp_path: Path) -> None:
    """Its scores follow from NumPy's generators and the environment alone, so they are the same on every machine."""
    part = leaderboard.read_entry(BOARDS / "grid-7x7" / "random.json").tasks[0]
    [spec] = expand(find_suite("grid-7x7"), ["random"], [part.results[0].seed], tasks=[part.task.name])
    record = run(spec, tmp_path)
    assert (record.scores, record.return_curve, record.success_curve) == (
        part.results[0].scores,
        part.results[0].return_curve,
        part.results[0].success_curve,
    )
