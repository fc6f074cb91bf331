"""Sweeps: what is tried, what is declared, and which setting is chosen."""

from __future__ import annotations

import json
import random
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from cli_calls import Capture, call
from sprl_bench import executors, sweeps
from sprl_bench.records import RunRecord, RunSpec
from sprl_bench.sweeps.declaration import ChangedSweepError
from sprl_bench.sweeps.report import as_csv, render

MakeRecord = Callable[..., RunRecord]
RANGES = {"k": [2, 5], "cost_scale": [0.002, 0.01]}
NAMES = ["sprl", "sprl+cost_scale=0.01", "sprl+k=5", "sprl+cost_scale=0.01+k=5"]


def declared(**changes: Any) -> sweeps.Declaration:
    fields: dict[str, Any] = {
        "suite": "grid-7x7",
        "suite_version": 1,
        "tasks": {"FourRooms-7x7": 500_000, "KeyDoors-7x7": 2_000_000},
        "seeds": (100, 101),
        "settings": {"sprl": tuple(sweeps.settings_of("sprl", "grid", [RANGES]))},
    }
    return sweeps.Declaration(**{**fields, **changes})


def trained(make_record: MakeRecord, levels: list[float]) -> list[RunRecord]:
    """Return all runs of the declaration; each setting has its level, and KeyDoors half of it."""
    return [
        make_record(name, task, seed, suite="grid-7x7", level=level * (1 if task.startswith("Four") else 0.5))
        for name, level in zip(NAMES, levels, strict=True)
        for task in ("FourRooms-7x7", "KeyDoors-7x7")
        for seed in (100, 101)
    ]


# ------------------------------------------------------------------------------------------ what is tried


@pytest.mark.usefixtures("fakes")
def test_all_combinations_under_their_shortest_names() -> None:
    settings = sweeps.settings_of("sprl", "grid", [RANGES])
    assert [setting.name for setting in settings] == NAMES
    assert [setting.values for setting in settings] == [
        {"k": k, "cost_scale": scale} for k in (2, 5) for scale in (0.002, 0.01)
    ]
    [own, other] = sweeps.settings_of("harness_fakes:walker+rollout=7", "grid", [{"pause_s": [0, 1.0]}])
    assert (own.name, other.name) == ("harness_fakes:walker+rollout=7", "harness_fakes:walker+pause_s=1.0+rollout=7")


def test_hyperparameters_that_change_together_stand_in_several_tables(tmp_path: Path) -> None:
    path = tmp_path / "ranges.toml"
    path.write_text("[[ppo]]\nanneal_learning_rate = [true]\nanneal_clip_range = [true]\n" * 2)
    path.write_text(path.read_text().replace("true", "false", 2))
    settings = sweeps.settings_of("ppo", "grid", sweeps.read_ranges(path, ["ppo"])["ppo"])
    assert [list(one.values.values()) for one in settings] == [[False, False], [True, True]]
    assert [one.name for one in settings] == ["ppo+anneal_clip_range=false+anneal_learning_rate=false", "ppo"]


@given(st.integers(1, 6), st.integers(0, 99))
def test_samples_are_distinct_and_follow_from_their_seed(samples: int, seed: int) -> None:
    drawn = sweeps.settings_of("sprl", "grid", [RANGES], samples, seed)
    assert drawn == sweeps.settings_of("sprl", "grid", [RANGES], samples, seed)
    assert len({setting.name for setting in drawn}) == min(samples, 4)
    assert {setting.name for setting in drawn} <= set(NAMES)


@pytest.mark.parametrize(
    ("agent", "domain", "count"),
    [
        ("ppo", "grid", 15),
        ("icm", "grid", 192),
        ("gt-grid", "grid", 15),
        ("eco", "grid", 12),
        ("sprl", "grid", 48),
        ("ppo", "fetch", 3),
        ("icm", "fetch", 7),
        ("eco", "fetch", 84),
        ("sprl", "fetch", 84),
        ("sprl", "dmlab", 81),
        ("ppo", "atari", 20),
        ("icm", "atari", 5),
        ("eco", "atari", 180),
        ("sprl", "atari", 480),
    ],
)
def test_the_papers_ranges_hold_its_final_values(agent: str, domain: str, count: int) -> None:
    """Every combination is allowed, and the plain preset is one of them; but for a value that the table contradicts."""
    settings = sweeps.settings_of(agent, domain, sweeps.table_ranges(agent, domain))
    assert len(settings) == count
    names = [setting.name for setting in settings]
    assert len(set(names)) == count
    assert (agent in names) is ((agent, domain) != ("sprl", "fetch"))


# -------------------------------------------------------------------------------------------- what is declared


def test_a_declaration_is_kept_and_no_other_is_taken(tmp_path: Path) -> None:
    sweeps.declare(declared(), tmp_path / "sweep")
    assert sweeps.read_declaration(tmp_path / "sweep") == declared()
    sweeps.declare(declared(), tmp_path / "sweep")
    with pytest.raises(ChangedSweepError, match=r"holds another sweep: seeds is \[100, 101\] there and \[100\] now"):
        sweeps.declare(declared(seeds=(100,)), tmp_path / "sweep")
    fewer = {"sprl": declared().settings["sprl"][:3]}
    with pytest.raises(ChangedSweepError, match="settings is 4 of sprl there and 3 of sprl now"):
        sweeps.declare(declared(settings=fewer), tmp_path / "sweep")
    with pytest.raises(FileNotFoundError, match="holds no sweep"):
        sweeps.read_declaration(tmp_path)
    assert (declared().num_runs, declared().env_steps) == (16, 20_000_000)


def test_the_specs_are_all_runs() -> None:
    specs = sweeps.specs_of(declared(tasks={"KeyDoors-7x7": 1_000, "FourRooms-7x7": 500_000}))
    assert len(specs) == 16
    assert {(spec.suite, spec.task.name, spec.task.budget) for spec in specs} == {
        ("custom", "KeyDoors-7x7-1000", 1_000),
        ("grid-7x7", "FourRooms-7x7", 500_000),
    }
    assert {spec.agent for spec in specs} == set(NAMES)


# -------------------------------------------------------------------------------------------- what is chosen


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=30)
@given(levels=st.lists(st.sampled_from([0.1, 0.4, 0.7]), min_size=4, max_size=4), order=st.randoms())
def test_the_choice_does_not_depend_on_the_order_of_the_runs(
    make_record: MakeRecord, levels: list[float], order: random.Random
) -> None:
    runs = trained(make_record, levels)
    [expected] = sweeps.rank(declared(), runs)
    order.shuffle(runs)
    [ranking] = sweeps.rank(declared(), runs)
    assert render(declared(), [ranking]) == render(declared(), [expected])
    assert as_csv([ranking]) == as_csv([expected])
    assert ranking.chosen is not None
    assert ranking.chosen.setting.name == NAMES[levels.index(max(levels))]
    assert ranking.chosen.mean == pytest.approx(0.75 * max(levels))


def test_equal_settings_are_called_equal(make_record: MakeRecord) -> None:
    for levels, ties in (([0.2, 0.7, 0.7, 0.7], 2), ([0.2, 0.7, 0.6, 0.6], 0)):
        [ranking] = sweeps.rank(declared(), trained(make_record, levels))
        assert (ranking.chosen and ranking.chosen.setting.name, ranking.ties) == (NAMES[1], ties)
        told = "the first declared of 3 settings with exactly this score" in render(declared(), [ranking])
        assert told is bool(ties)


def test_nothing_is_chosen_while_a_run_is_missing(make_record: MakeRecord) -> None:
    runs = trained(make_record, [0.1, 0.2, 0.3, 0.4])
    [ranking] = sweeps.rank(declared(), runs[:-1])
    assert (ranking.missing, ranking.chosen, ranking.sensitivity) == (1, None, None)
    page = render(declared(), [ranking])
    assert "Not complete: 1 runs are missing, so no setting is chosen." in page
    assert "(runs missing)" in page
    [nothing] = sweeps.rank(declared(), [])
    assert (nothing.missing, nothing.settings) == (16, ())
    assert "16 runs are missing" in render(declared(), [nothing])


def test_other_runs_are_left_out(make_record: MakeRecord) -> None:
    runs = trained(make_record, [0.1, 0.2, 0.3, 0.4])
    others = [make_record("sprl", seed=0, suite="grid-7x7"), make_record("ppo", seed=100, suite="grid-7x7")]
    assert as_csv(sweeps.rank(declared(), [*runs, *others])) == as_csv(sweeps.rank(declared(), runs))


# --------------------------------------------------------------------------------------- on the command line

SWEEP = ["sweep", "--suite", "smoke", "--workers", "1", "--device", "cpu", "--budget-share", "0.01", "--seeds", "2"]


@pytest.mark.usefixtures("fakes")
def test_from_the_command_to_the_choice(capsys: Capture, tmp_path: Path) -> None:
    (tmp_path / "ranges.json").write_text(json.dumps({"harness_fakes:walker": {"rollout": [8, 9], "num_envs": [3, 4]}}))
    command = [
        *SWEEP,
        "--agents",
        "harness_fakes:walker",
        "--range",
        tmp_path / "ranges.json",
        "--out",
        tmp_path / "out",
    ]
    status, printed, err = call(capsys, *command, "--dry-run")
    assert status == 0
    assert "4 settings on 1 task with 2 seeds: 8 runs, 8,000 env steps." in err
    assert len(printed.splitlines()) == 4
    assert not (tmp_path / "out").exists()
    status, printed, err = call(capsys, *command)
    assert (status, f"sprl-bench sweep report {tmp_path / 'out'}" in printed) == (0, True)
    assert "0 runs" not in err
    assert call(capsys, *command)[0] == 0
    status, printed, err = call(capsys, "sweep", "report", tmp_path / "out")
    assert status == 0
    assert "Chosen: `harness_fakes:walker" in printed
    written = sorted(path.name for path in (tmp_path / "out").iterdir() if path.is_file())
    assert written == ["harness_fakes-walker.png", "report.csv", "report.md", "sweep.json"]
    status, _, err = call(capsys, *command, "--seeds", "3")
    assert (status, "holds another sweep: seeds" in err) == (1, True)


@pytest.mark.usefixtures("fakes")
def test_the_report_does_not_depend_on_workers_or_an_interruption(
    capsys: Capture, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two workers; and one that is interrupted after two runs and continues."""
    ranges = tmp_path / "ranges.toml"
    ranges.write_text('["harness_fakes:walker"]\nnum_envs = [3, 4]\n')
    command = [*SWEEP, "--agents", "harness_fakes:walker", "--range", ranges]
    assert call(capsys, *command, "--workers", "2", "--out", tmp_path / "two")[0] == 0
    make_executor = executors.make_executor
    monkeypatch.setattr(executors, "make_executor", lambda *_: Interrupted())
    assert call(capsys, *command, "--out", tmp_path / "one")[0] == 130
    assert len(list((tmp_path / "one").rglob("record.json"))) == 2
    monkeypatch.setattr(executors, "make_executor", make_executor)
    assert call(capsys, *command, "--out", tmp_path / "one")[0] == 0
    reports = [call(capsys, "sweep", "report", tmp_path / name)[1] for name in ("one", "two")]
    assert reports[0] == reports[1]
    assert (tmp_path / "one" / "report.csv").read_bytes() == (tmp_path / "two" / "report.csv").read_bytes()


class Interrupted:
    """Computes two runs in this process, and then gets Ctrl-C."""

    def map(self, function: Callable[[RunSpec], Any], specs: Sequence[RunSpec]) -> Iterator[tuple[RunSpec, Any]]:
        for spec in specs[:2]:
            yield spec, function(spec)
        raise KeyboardInterrupt


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            ["--agents", "ppo", "--seeds", "0,1"],
            "seeds holds 0, which is reserved for leaderboards; it must hold seeds",
        ),
        (["--agents", "random"], "range is 'table'; it must be a file for random"),
        (["--agents", "ppo", "--budget-share", "0"], "budget_share is 0.0; it must be above 0 and at most 1"),
        (["--agents", "ppo,ppo"], "it must name each agent once"),
        (["--agents", "ppo+learning_rate=0.1"], "it must not give learning_rate, which the sweep varies"),
        ([], "agents is missing; a sweep needs both --suite and --agents"),
        (["--agents", "ppo", "--range", "broken.toml"], "range is broken.toml; it must be TOML"),
        (
            ["--agents", "ppo", "--range", "other.toml"],
            "range is other.toml; it must have a table [ppo], and has gt-grid, count, sprl",
        ),
        (["--agents", "sprl", "--range", "other.toml"], "other.toml: sprl.k is 3; it must be a list of values"),
        (["--agents", "icm", "--range", "other.toml"], "k of icm is [1, 1]; it must have each value once"),
        (["--agents", "eco", "--range", "other.toml"], "Unknown hyperparameter 'kk'"),
        (["--agents", "gt-grid", "--range", "other.toml"], "other.toml: gt-grid is 3; it must be a table"),
        (
            ["--agents", "rnd", "--range", "other.toml"],
            "one table of rnd holds k; all must hold the same, bonus_weight",
        ),
        (["--agents", "count", "--range", "other.toml"], "count is []; it must be a table"),
        (["--agents", "gt-sprl", "--range", "other.toml"], "The tables of gt-sprl give gt-sprl+k=4 twice"),
        (["--agents", "ppo", "--range", "nowhere.toml"], "nowhere.toml: No such file"),
        (["--agents", "ppo", "--suite", "smok"], "Unknown suite 'smok'; did you mean 'smoke'"),
        (["--agents", "ppo", "--task", "KeyDoors"], "Unknown task of suite 'smoke': 'KeyDoors'"),
    ],
)
def test_what_is_refused_before_anything_is_written(
    changes: list[str], message: str, capsys: Capture, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("broken.toml").write_text("[ppo\n")
    Path("other.toml").write_text(
        "gt-grid = 3\ncount = []\n[sprl]\nk = 3\n[icm]\nk = [1, 1]\n[eco]\nkk = [1]\n"
        "[[rnd]]\nbonus_weight = [1]\n[[rnd]]\nk = [1]\n[[gt-sprl]]\nk = [4]\n[[gt-sprl]]\nk = [3, 4]\n"
    )
    status, _, err = call(capsys, *SWEEP, *changes)
    assert status != 0
    assert message in err
    assert not Path("sweep").exists()
