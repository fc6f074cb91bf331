"""Frames: they hold what the records hold, with the types that are documented."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from pathlib import Path

import pandas as pd
import pytest

from sprl_bench import frames, leaderboard
from sprl_bench.records import InvalidFileError, RunRecord
from sprl_bench.records.folder import METRICS
from sprl_bench.run import run
from sprl_bench.suite import expand
from sprl_bench.tables import tabulate
from sprl_bench.tables.table import MEASURES
from sprl_bench.tasks import find_suite

WriteRuns = Callable[[list[RunRecord]], Path]
KEY = ["suite", "task", "agent", "seed"]


@pytest.fixture(scope="module")
def trained(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two agents, one of them with a hyperparameter that the other has not; 600 env steps each."""
    root = tmp_path_factory.mktemp("trained")
    for spec in expand(find_suite("smoke"), ["random+num_envs=5", "ppo+num_envs=6"], [0, 3], budget=1600):
        run(spec, root)
    return root


def test_runs_are_the_records(trained: Path, grid_7x7: list[RunRecord], write_runs: WriteRuns) -> None:
    frame = frames.runs(write_runs(grid_7x7))
    assert (frame.index.names, len(frame)) == (KEY, 20)
    for record in grid_7x7:
        spec = record.spec
        row = frame.loc[spec.suite, spec.task.name, spec.agent, spec.seed]
        assert {name: row[name] for name in ("auc", "final", "success_auc", "success_final")} == {
            name: value for name, value in record.scores if name != "steps_to_threshold"
        }
        steps = record.scores.steps_to_threshold
        assert row["steps_to_threshold"] is pd.NA if steps is None else row["steps_to_threshold"] == steps
        assert (row["wall_time_s"], row["env_steps"], row["num_envs"]) == (1.5, spec.task.budget, 12)
        assert (row["status"], row["cpu"], row["fingerprint"]) == ("complete", "made up", record.fingerprint)
    variants = frames.runs(trained)
    assert [json.loads(text) for text in variants["differences"]] == [{"num_envs": 6}] * 2 + [{"num_envs": 5}] * 2
    assert variants["preset"].tolist() == ["table", "table", "", ""]


def test_types_do_not_depend_on_the_data(trained: Path, grid_7x7: list[RunRecord], write_runs: WriteRuns) -> None:
    frame = frames.runs(write_runs(grid_7x7))
    assert frame.dtypes.map(str).to_dict() == frames.runs(trained).dtypes.map(str).to_dict()
    kinds = frame.dtypes.map(str).to_dict()
    text = {"status", "preset", "differences", "observation", "device", "fingerprint", "git_commit", "cpu"}
    assert {name for name, kind in kinds.items() if kind == "string"} == text
    assert {name for name, kind in kinds.items() if kind == "Int64"} == {"steps_to_threshold"}
    assert {name for name, kind in kinds.items() if kind == "bool"} == {"privileged"}
    assert {kinds[name] for name in ("budget", "num_envs", "torch_threads", "env_steps", "episodes")} == {"int64"}
    assert {kinds[name] for name in ("auc", "final", "mean_return", "wall_time_s")} == {"float64"}
    assert frame.index.dtypes.map(str).to_dict() == dict(zip(KEY, ["string"] * 3 + ["int64"], strict=True))


def test_hyperparameters_are_missing_where_an_agent_has_none(trained: Path) -> None:
    frame = frames.hyperparameters(trained)
    [ppo, random] = [frame.xs(agent, level="agent").iloc[0] for agent in ("ppo+num_envs=6", "random+num_envs=5")]
    assert (ppo["num_envs"], random["num_envs"], ppo["learning_rate"]) == (6, 5, 0.003)
    assert random["learning_rate"] is pd.NA
    kinds = {name: str(frame[name].dtype) for name in ("epochs", "learning_rate", "clip_value", "discount_per")}
    assert list(kinds.values()) == ["Int64", "Float64", "boolean", "string"]


def test_atari_scores_are_normalised_by_random_and_human_play(
    make_record: Callable[..., RunRecord], write_runs: WriteRuns, trained: Path
) -> None:
    levels = {"Freeway": 14.8, "Hero": 1027.0}
    root = write_runs([make_record("ppo", task, suite="atari", level=level) for task, level in levels.items()])
    found = frames.human_normalized(root)
    assert found["auc"].tolist() == found["final"].tolist() == [0.5, 0.0]
    with pytest.raises(ValueError, match="no run"):
        frames.human_normalized(trained)


def test_curves_episodes_and_metrics_are_the_files(trained: Path) -> None:
    [one, *_] = expand(find_suite("smoke"), ["ppo+num_envs=6"], [3], budget=1600)
    record, place = run(one, trained), ("custom", "FourRooms-7x7-1600", "ppo+num_envs=6", 3)
    curve = frames.curves(trained).loc[place]
    assert curve["env_steps"].tolist() == list(range(16, 1616, 16))
    assert tuple(curve["return"]) == record.return_curve
    assert tuple(curve["success"]) == record.success_curve
    episodes = frames.episodes(trained).loc[place]
    assert len(episodes) == record.totals.episodes
    assert episodes["return"].mean() == pytest.approx(record.totals.mean_return)
    assert episodes["stamp"].is_monotonic_increasing
    metrics = frames.metrics(trained)
    lines = [json.loads(line) for line in (one.path(trained) / METRICS).read_text().splitlines()]
    told = metrics.loc[place].dropna(axis="columns", how="all")
    assert told["entropy"].tolist() == [line["entropy"] for line in lines]
    assert told["env_steps"].tolist() == [line["env_steps"] for line in lines]
    assert metrics.xs("random+num_envs=5", level="agent")["entropy"].isna().all()
    assert set(metrics.dtypes.map(str)) == {"int64", "float64"}


def test_metrics_of_a_run_that_is_not_finished(tmp_path: Path, fakes: None) -> None:
    [spec] = expand(find_suite("smoke"), ["harness_fakes:walker+trouble=raise+after=3"], [0])
    with pytest.raises(ZeroDivisionError):
        run(spec, tmp_path)
    assert frames.metrics(tmp_path)["updates"].tolist() == [1.0, 2.0]


def test_boards_are_their_entries(home: Path, grid_7x7: list[RunRecord]) -> None:
    frame = frames.board("grid-7x7", home)
    assert (len(frame), frame.index.names) == (20, KEY)
    assert frame.loc["grid-7x7", "KeyDoors-7x7", "ppo", 2]["auc"] == pytest.approx(0.62)
    curves = frames.board_curves("grid-7x7", home)
    assert len(curves) == 2_000
    assert curves.loc["grid-7x7", "FourRooms-7x7", "random", 4]["return"].tolist() == pytest.approx([0.14] * 100)
    assert len(frames.board("grid-7x7")) >= 100  # the published one


def test_a_table_and_a_comparison_as_frames(home: Path, grid_7x7: list[RunRecord]) -> None:
    [table] = tabulate(grid_7x7)
    frame = table.to_frame()
    assert len(frame) == 2 * (2 * len(MEASURES) + len(MEASURES) + 1)
    for row in table.rows:
        assert row.auc is not None
        assert row.auc.interval is not None
        told = frame.loc[row.agent, "all", "auc"]
        assert (told["value"], told["low"], told["high"], told["seeds"]) == (row.auc.value, *row.auc.interval, 5)
    [comparison] = leaderboard.compare(grid_7x7, leaderboard.find_entries(home / "grid-7x7")[:1], agent="random")
    frame = comparison.to_frame()
    assert frame.index.tolist() == [
        ("random", "ppo", task) for task in ("FourRooms-7x7", "KeyDoors-7x7", "all", "all, IQM")
    ]
    assert frame.loc["random", "ppo", "all"]["difference"] == comparison.overall.difference
    told = frame.loc["random", "ppo", "all"]
    assert (told["p_value"], told["improvement"]) == (comparison.overall.p_value, comparison.overall.improvement)
    assert (told["improvement_low"], told["improvement_high"]) == comparison.overall.improvement_interval
    single = [record for record in grid_7x7 if record.spec.seed == 0]
    [table] = tabulate(single)
    assert table.to_frame()["low"].isna().all()


def test_what_is_missing_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, trained: Path) -> None:
    for make in (frames.runs, frames.curves, frames.episodes, frames.metrics, frames.hyperparameters):
        with pytest.raises(FileNotFoundError, match="nowhere does not exist"):
            make(tmp_path / "nowhere")
        with pytest.raises(ValueError, match="nothing to make a frame of"):
            make(str(tmp_path))
    with pytest.raises(FileNotFoundError, match="is not a folder of leaderboard entries"):
        frames.board("nowhere")
    (tmp_path / METRICS).write_text("{}\nnot\n")
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(ModuleNotFoundError, match=r"pandas is not installed; install it with: pip install .*plots"):
        frames.runs(trained)


def test_broken_metrics_are_named(tmp_path: Path, trained: Path) -> None:
    [spec] = expand(find_suite("smoke"), ["random"], [0], budget=600)
    run(spec, tmp_path)
    with (spec.path(tmp_path) / METRICS).open("ab") as file:
        file.write(b'{"env_steps": 6')
    assert len(frames.metrics(tmp_path)) > 0  # the last line is still being written
    with (spec.path(tmp_path) / METRICS).open("ab") as file:
        file.write(b"\n")
    with pytest.raises(InvalidFileError, match=r"metrics\.jsonl is broken; each line must be a JSON object"):
        frames.metrics(tmp_path)
