"""Pending runs: however they come together, the entry is the same; and what they count for until then."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from cli_calls import Capture, call
from entries import make_entry
from sprl_bench import leaderboard
from sprl_bench.records import InvalidFileError, RunRecord, write
from sprl_bench.records.folder import RECORD, LockedError, lock
from sprl_bench.suite import expand
from sprl_bench.tables import IncomparableError
from sprl_bench.tasks import find_suite

MakeRecord = Callable[..., RunRecord]
SUITE = "grid-7x7"


def kept(home: Path, agent: str = "ppo") -> leaderboard.PendingEntry:
    return leaderboard.read_pending(leaderboard.pending_path(home, SUITE, agent))


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=30)  # the runs never change
@given(parts=st.lists(st.integers(0, 3), min_size=10, max_size=10), order=st.permutations(range(4)))
def test_the_entry_does_not_depend_on_how_the_runs_came_together(
    grid_7x7: list[RunRecord], parts: list[int], order: list[int]
) -> None:
    mine = [run for run in grid_7x7 if run.spec.agent == "ppo"]
    with TemporaryDirectory() as folder:
        home = Path(folder)
        for part in order:
            if runs := [run for run, its in zip(mine, parts, strict=True) if its == part]:
                leaderboard.add_pending(runs, home, agent="ppo")
        assert leaderboard.missing_runs(kept(home)) == 0
        entry = make_entry(list(kept(home).runs))
        assert entry == make_entry(grid_7x7)
        assert leaderboard.add_entry(entry, home).read_bytes() == _written(grid_7x7, home / "other")


def _written(runs: list[RunRecord], home: Path) -> bytes:
    return leaderboard.add_entry(make_entry(runs), home).read_bytes()


def test_runs_that_are_there_stay_and_boards_do_not_show_them(grid_7x7: list[RunRecord], home: Path) -> None:
    before = leaderboard.boards(home)
    [path] = leaderboard.add_pending(grid_7x7[:3], home, agent="ppo")
    assert [run.spec.seed for run in kept(home).runs] == [0, 1, 2]
    assert leaderboard.missing_runs(kept(home)) == 7
    first = path.read_bytes()
    slower = grid_7x7[0].model_copy(update={"wall_time_s": 9.0})
    leaderboard.add_pending([slower, *grid_7x7[:2]], home, agent="ppo")
    assert path.read_bytes() == first
    assert leaderboard.boards(home) == before
    assert leaderboard.validate([path]) == []
    assert leaderboard.find_pending(home) == leaderboard.find_pending(path.parent) == [kept(home)]


def test_only_finished_runs_of_published_suites_are_kept(make_record: MakeRecord, tmp_path: Path) -> None:
    smoke, unfinished = make_record("ppo"), make_record("ppo", seed=1, status="incomplete")
    custom = smoke.model_copy(update={"spec": smoke.spec.model_copy(update={"suite": "custom"})})
    [path] = leaderboard.add_pending([smoke, custom, unfinished], tmp_path, agent="ppo")
    assert path == tmp_path / "pending" / "smoke" / "ppo.json"
    assert leaderboard.read_pending(path).runs == (smoke,)
    with pytest.raises(ValueError, match="agent is 'icm'; it must have a finished run of a published suite"):
        leaderboard.add_pending([smoke], tmp_path, agent="icm")
    with pytest.raises(ValueError, match="it must have a finished run of grid-7x7"):
        leaderboard.add_pending([smoke], tmp_path, agent="ppo", suite="grid-7x7")


def test_another_result_of_a_pending_run_is_refused(make_record: MakeRecord, tmp_path: Path) -> None:
    leaderboard.add_pending([make_record("ppo", level=0.5)], tmp_path, agent="ppo")
    with pytest.raises(IncomparableError, match=r"seed 0 of ppo on FourRooms-7x7 is pending already, .*: other"):
        leaderboard.add_pending([make_record("ppo", level=0.6)], tmp_path, agent="ppo")
    leaderboard.add_pending([make_record("icm", hyperparameters={"rate": 1})], tmp_path, agent="icm")
    with pytest.raises(IncomparableError, match="rate: 1 on disk, 2 now"):
        leaderboard.add_pending([make_record("icm", hyperparameters={"rate": 2})], tmp_path, agent="icm")


def test_runs_that_no_entry_could_hold_are_refused(make_record: MakeRecord, tmp_path: Path) -> None:
    leaderboard.add_pending([make_record("ppo")], tmp_path, agent="ppo")
    with pytest.raises(IncomparableError, match="seeds differ in the hyperparameter"):
        leaderboard.add_pending([make_record("ppo", seed=1, hyperparameters={"rate": 2})], tmp_path, agent="ppo")
    newer = make_record("ppo", seed=1)
    newer = newer.model_copy(update={"versions": {**newer.versions, "numpy": "9.9"}})
    with pytest.raises(
        IncomparableError, match="The seeds of a task are made with one version of numpy; those of FourRooms-7x7"
    ):
        leaderboard.add_pending([newer], tmp_path, agent="ppo")
    [one] = leaderboard.find_pending(tmp_path)
    assert len(one.runs) == 1


def test_two_writers_do_not_lose_a_run(make_record: MakeRecord, tmp_path: Path) -> None:
    place = leaderboard.pending_path(tmp_path, "smoke", "ppo").parent
    with lock(place), pytest.raises(LockedError, match="is in use by another process"):
        leaderboard.add_pending([make_record("ppo", suite="smoke")], tmp_path, agent="ppo")


def test_a_broken_or_misplaced_file_is_named(make_record: MakeRecord, tmp_path: Path) -> None:
    runs = [make_record("ppo", suite="smoke", seed=seed) for seed in range(2)]
    [path] = leaderboard.add_pending(runs, tmp_path, agent="ppo")
    moved = path.with_name("icm.json")
    moved.write_bytes(path.read_bytes())
    with pytest.raises(InvalidFileError, match=r"the runs of ppo on smoke belong in pending/smoke/ppo\.json"):
        leaderboard.find_pending(tmp_path)
    assert leaderboard.validate([path, moved])[0].startswith(f"{moved}:1: ")
    moved.unlink()
    for changed, complaint in [
        ((runs[0], runs[0]), "one seed of one task twice"),
        ((runs[0], make_record("icm", suite="smoke")), "more than one agent or suite"),
        ((make_record("ppo", suite="smoke", status="incomplete"),), "an incomplete run"),
    ]:
        write(path, leaderboard.PendingEntry.model_construct(runs=changed))
        with pytest.raises(InvalidFileError, match=complaint):
            leaderboard.read_pending(path)


# ------------------------------------------------------------------------------------- on the command line


def test_a_campaign_goes_on_elsewhere(capsys: Capture, tmp_path: Path, fakes: None) -> None:
    """One seed here, the other there: the second folder trains only what is not known, and its table shows both."""
    run = ["run", "--suite", "smoke", "--agents", "random+num_envs=100", "--workers", "1", "--device", "cpu"]
    home = tmp_path / "boards"
    assert call(capsys, *run, "--seeds", "1", "--out", tmp_path / "here")[0] == 0
    add = ["leaderboard", "add", "--agent", "random+num_envs=100", "--pending", "--home", home]
    status, _, err = call(capsys, *add, tmp_path / "here")
    assert status == 0
    assert "random+num_envs=100.json: 1 runs, 4 missing." in err
    status, printed, err = call(capsys, *run, "--seeds", "5", "--known", home, "--out", tmp_path / "there")
    assert status == 0
    assert f"1 of 5 runs are known from {home}." in err
    assert "random+num_envs=100" in printed
    assert len(list((tmp_path / "there").rglob(RECORD))) == 4
    assert "0 missing" in call(capsys, *add, tmp_path / "there")[2]
    status, printed, err = call(capsys, "leaderboard", "show", "--pending", "--home", home)
    assert (status, "random+num_envs=100" in printed) == (0, True)
    promote = ["leaderboard", "promote", "--suite", "smoke", "--agent", "random+num_envs=100", "--home", home]
    status, _, err = call(capsys, *promote)
    assert (status, "author is missing; an entry must name its authors and a link." in err) == (2, True)
    status, _, err = call(capsys, *promote, "--author", "Ada L.", "--link", "https://example.org/paper")
    assert status == 0
    assert (home / "smoke" / "random+num_envs=100.json").exists()
    assert not (home / "pending" / "smoke" / "random+num_envs=100.json").exists()
    assert "no pending run" in call(capsys, "leaderboard", "show", "--pending", "--home", home)[2]


def test_an_incomplete_entry_is_not_promoted(capsys: Capture, make_record: MakeRecord, tmp_path: Path) -> None:
    [path] = leaderboard.add_pending([make_record("ppo", suite="smoke")], tmp_path, agent="ppo")
    promote = ["leaderboard", "promote", "--suite", "smoke", "--agent", "ppo", "--home", tmp_path]
    status, _, err = call(capsys, *promote, "--author", "Ada L.", "--link", "https://example.org/paper")
    assert (status, path.exists()) == (1, True)
    assert "An entry needs at least 5 seeds; ppo has 1." in err


def test_a_known_run_of_another_spec_is_refused(tmp_path: Path, make_record: MakeRecord) -> None:
    [spec] = expand(find_suite("smoke"), ["random"], [0])
    record = make_record("random", suite="smoke")
    known = leaderboard.PendingEntry(runs=(record.model_copy(update={"spec": spec}),))
    [other] = expand(find_suite("smoke"), ["random"], [0], overrides={"num_envs": 3})
    [next_seed] = expand(find_suite("smoke"), ["random"], [1])
    assert leaderboard.split_known([spec, next_seed], [known]) == ([next_seed], list(known.runs))
    with pytest.raises(IncomparableError, match="but as another run: num_envs: 12 on disk, 3 now"):
        leaderboard.split_known([other], [known])


def test_paths_may_be_strings(make_record: MakeRecord, tmp_path: Path) -> None:
    home = str(tmp_path)
    [path] = leaderboard.add_pending([make_record("ppo")], home, agent="ppo")
    assert leaderboard.read_pending(str(path)) == leaderboard.find_pending(home)[0]
    assert leaderboard.pending_path(home, "smoke", "ppo") == tmp_path / "pending" / "smoke" / "ppo.json"
    assert leaderboard.entry_path(home, "smoke", "ppo") == tmp_path / "smoke" / "ppo.json"
    board = Path(__file__).parents[2] / "leaderboards" / "grid-7x7"
    assert leaderboard.read_entry(str(board / "ppo.json")).agent == "ppo"
    for name in leaderboard.__all__:
        kinds = getattr(getattr(leaderboard, name), "__annotations__", {})
        assert "Path" not in [kind for part, kind in kinds.items() if part != "return"], name
