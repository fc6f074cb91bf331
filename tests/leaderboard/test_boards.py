"""Boards: what is computed from entries, where boards are found, and what a package carries of them."""

from __future__ import annotations

import subprocess
import sys
import zipfile
from collections.abc import Callable
from pathlib import Path

import pytest

from entries import make_entry
from sprl_bench import leaderboard, shipped
from sprl_bench.leaderboard import Entry
from sprl_bench.records import RunRecord
from sprl_bench.tables import FORMATS, IncomparableError, render

MakeRecord = Callable[..., RunRecord]
ROOT = Path(__file__).parents[2]


def test_a_board_is_computed_from_its_entries(home: Path) -> None:
    [board] = leaderboard.boards(home)
    assert [row.agent for row in board.rows] == ["ppo", "random"]
    assert board.rows[0].auc is not None
    assert board.rows[0].auc.value == pytest.approx(0.57)
    assert board.notes == (
        "ppo: reported, recorded; Ada L.; https://example.org/paper_1; all runs together took 15 s",
        "random: reported, recorded; Ada L.; https://example.org/paper_1; all runs together took 15 s",
    )


def test_what_an_entry_says_cannot_break_out_of_a_board(grid_7x7: list[RunRecord], tmp_path: Path) -> None:
    leaderboard.add_entry(make_entry(grid_7x7, authors=["a|b <i> [l](u)"]), tmp_path)
    board = leaderboard.boards(tmp_path)
    assert r"a\|b \<i\> [l]\(u)" in render(board, "md")
    assert r"a|b <i> [l](u)" in render(board, "latex")


def test_a_board_is_rebuilt_byte_for_byte(home: Path) -> None:
    first, second = leaderboard.boards(home), leaderboard.boards(home, "grid-7x7")
    for form in FORMATS:
        assert render(first, form) == render(second, form)


def test_the_best_comes_first_privileged_or_not(make_record: MakeRecord, tmp_path: Path) -> None:
    for agent, level in (("a", 0.2), ("b", 0.9), ("c", 0.5)):
        records = [make_record(agent, seed=seed, level=level, privileged=agent == "b") for seed in range(5)]
        leaderboard.add_entry(make_entry(records, agent), tmp_path)
    [board] = leaderboard.boards(tmp_path)
    assert [row.agent for row in board.rows] == ["b", "c", "a"]
    assert "| b † | 5 | 0.900" in render([board], "md")


def test_an_agent_by_two_presets_has_two_entries_on_one_board(make_record: MakeRecord, tmp_path: Path) -> None:
    for agent, level in (("sprl", 0.2), ("sprl@tuned", 0.4)):
        records = [make_record(agent, seed=seed, level=level, hyperparameters={"k": level}) for seed in range(5)]
        path = leaderboard.add_entry(make_entry(records, agent), tmp_path)
        assert (path.name, leaderboard.validate([path])) == (f"{agent}.json", [])
    [board] = leaderboard.boards(tmp_path)
    assert [row.agent for row in board.rows] == ["sprl@tuned", "sprl"]


def test_entries_of_other_environments_share_no_board(make_record: MakeRecord, tmp_path: Path) -> None:
    def entry(agent: str, fingerprint: str) -> Entry:
        return make_entry([make_record(agent, seed=seed, fingerprint=fingerprint) for seed in range(5)], agent)

    leaderboard.add_entry(entry("a", "a" * 16), tmp_path)
    with pytest.raises(IncomparableError, match="fingerprint differs"):
        leaderboard.add_entry(entry("b", "b" * 16), tmp_path)
    assert [row.agent for row in leaderboard.boards(tmp_path)[0].rows] == ["a"]
    # Its own entry may be replaced by one of another environment while it is alone there.
    assert leaderboard.add_entry(entry("a", "b" * 16), tmp_path, replace=True)


def test_a_board_is_found_by_its_name_its_folder_or_one_entry(home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from sprl_bench.leaderboard import store

    monkeypatch.setattr(store, "home", lambda: home)
    for name in (Path("grid-7x7"), home / "grid-7x7"):
        assert [entry.agent for entry in leaderboard.find_board(name)] == ["ppo", "random"]
    assert [entry.agent for entry in leaderboard.find_board(home / "grid-7x7" / "ppo.json")] == ["ppo"]
    with pytest.raises(ValueError, match="the folder of all boards; name one of them: grid-7x7"):
        leaderboard.find_board(home)
    with pytest.raises(FileNotFoundError, match=r"Unknown entry or board 'grid'.* 'grid-7x7'"):
        leaderboard.find_board(Path("grid"))
    (home / "runs" / "grid-7x7").mkdir(parents=True)  # a folder of runs by that name is no board
    monkeypatch.chdir(home / "runs")
    assert len(leaderboard.find_board(Path("grid-7x7"))) == 2


def test_boards_that_are_not_there_are_refused(home: Path, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="did you mean 'grid-7x7'"):
        leaderboard.boards(home, "grid-7")
    with pytest.raises(ValueError, match="has no entry for a current suite"):
        leaderboard.boards(tmp_path / "nowhere")
    with pytest.raises(FileNotFoundError, match="not a folder of leaderboard entries"):
        leaderboard.find_entries(tmp_path / "nowhere")
    with pytest.raises(ValueError, match="no entry yet"):
        leaderboard.board([])


def test_the_schema_in_the_repository_is_that_of_the_types() -> None:
    """If this fails: sprl-bench leaderboard schema -o leaderboards/schema.json."""
    assert (ROOT / "leaderboards" / "schema.json").read_text() == leaderboard.schema()
    assert leaderboard.home() == ROOT / "leaderboards"


def test_a_wheel_carries_its_boards_its_pins_and_its_types(tmp_path: Path) -> None:
    build = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(tmp_path)]
    subprocess.run(build, cwd=ROOT, check=True, capture_output=True)
    [wheel] = tmp_path.glob("*.whl")
    with zipfile.ZipFile(wheel) as opened:
        names = set(opened.namelist())
        schema = opened.read("sprl_bench/_leaderboards/schema.json").decode()
    assert names >= {
        "sprl_bench/_constraints.txt",
        "sprl_bench/py.typed",
        "sprl_baselines/py.typed",
        "sprl_baselines/ppo.py",
    }
    assert schema == leaderboard.schema()


def test_an_installed_package_reads_its_own_boards(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(shipped, "__file__", str(tmp_path / "sprl_bench" / "shipped.py"))
    assert leaderboard.home() == tmp_path / "sprl_bench" / "_leaderboards"
