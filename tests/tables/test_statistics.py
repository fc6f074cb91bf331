"""Tables of other statistics: what stands in them by hand, and that they show the runs of an ordinary table."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Callable
from pathlib import Path

import gymnasium
import numpy as np
import pytest

from sprl_bench import frames, solver
from sprl_bench.cli import main
from sprl_bench.envs import GRID_IDS, MAZE_IDS
from sprl_bench.outcomes import wilson_interval
from sprl_bench.records import RunRecord
from sprl_bench.tables import FORMATS, Result, tabulate
from sprl_bench.tables.statistics import STATISTICS, StatisticTable, tabulate_statistic
from sprl_bench.tables.statistics_text import render_statistic
from sprl_bench.tasks import ORACLES, SUITES

MakeRecord = Callable[..., RunRecord]


def table_of(runs: list[RunRecord], statistic: str) -> StatisticTable:
    [table] = tabulate_statistic(tabulate(runs), [Result.of(run) for run in runs], statistic)
    return table


def late(make_record: MakeRecord, seed: int, first_bin: int) -> RunRecord:
    """A run that fails, and succeeds always from some bin on."""
    return make_record(seed=seed, curve=[0.0] * first_bin + [1.0] * (100 - first_bin))


def test_solved_seeds_by_hand(make_record: MakeRecord) -> None:
    # Over the last ten bins the four succeed in 100, 50, 40 and 0 of 100 episodes.
    table = table_of([late(make_record, seed, first) for seed, first in enumerate((90, 95, 96, 100))], "solved")
    [cell] = table.rows[0].cells
    assert (cell.value, cell.count, cell.seeds) == (0.5, 2, 4)
    assert (cell.low, cell.high) == wilson_interval(2, 4)
    assert "| ppo | 0.500 [0.150, 0.850] 2 of 4 |" in render_statistic([table], "md")


def test_the_first_goal_by_hand(make_record: MakeRecord) -> None:
    runs = [late(make_record, seed, first) for seed, first in enumerate((4, 9, 49, 100, 100))]
    table = table_of(runs, "first-goal")
    [cell] = table.rows[0].cells
    assert (cell.value, cell.high, cell.count, cell.seeds) == (50_000.0, None, 3, 5)
    assert "50,000 [5,000, -] 3 of 5" in render_statistic([table], "md")
    assert table_of(runs[3:], "first-goal").rows[0].cells[0].value is None


def test_the_oracle_scores_one(make_record: MakeRecord) -> None:
    oracle = ORACLES["SPRL/FourRooms-7x7-v1"]
    table = table_of([make_record(seed=seed, level=oracle / (1 + seed)) for seed in range(2)], "oracle")
    [cell] = table.rows[0].cells
    assert (cell.value, cell.low, cell.high) == (pytest.approx(0.75), pytest.approx(0.5), pytest.approx(1.0))


def test_a_task_without_a_solver_has_no_oracle(make_record: MakeRecord) -> None:
    runs = [make_record(task=task.name, suite="fetch") for task in SUITES["fetch"].tasks]
    table = table_of(runs, "oracle")
    assert {cell.value for cell in table.rows[0].cells} == {None}


def test_oracles_are_the_solvers_mean_returns() -> None:
    assert set(ORACLES) == {*GRID_IDS, *MAZE_IDS}
    for env_id in GRID_IDS:
        envs = gymnasium.make_vec(env_id, 2_000)
        returns = 1 - 0.9 * solver.distances_to_goal(envs.reset(seed=7)[0]) / 100
        error = returns.std() / np.sqrt(len(returns))
        assert abs(returns.mean() - ORACLES[env_id]) < 4 * error + 0.0001


def test_a_run_of_the_solver_scores_about_one() -> None:
    env = gymnasium.make("SPRL/KeyDoors-7x7-v1")
    total = []
    for seed in range(300):
        observation, _ = env.reset(seed=seed)
        rewards = [env.step(action)[1] for action in solver.shortest_path(observation)]
        total.append(sum(rewards))
    assert np.mean(total) / ORACLES["SPRL/KeyDoors-7x7-v1"] == pytest.approx(1, abs=0.01)


@pytest.mark.parametrize("form", FORMATS)
@pytest.mark.parametrize("statistic", sorted(STATISTICS))
def test_every_format_shows_every_statistic(statistic: str, form: str, grid_7x7: list[RunRecord]) -> None:
    table = table_of(grid_7x7, statistic)
    text = render_statistic([table], form)
    value = table.rows[0].cells[1].value
    assert value is not None
    if form == "json":
        assert json.loads(text)[0]["rows"][0]["cells"][1]["value"] == round(value, 6)
    elif form == "csv":
        lines = list(csv.DictReader(io.StringIO(text)))
        assert [float(line["value"]) for line in lines[1:2]] == [round(value, 6)]
        assert len(lines) == 4
    else:
        assert "Drops: none; the table has all 20 planned runs." in text
        assert (f"{value:,.0f}" if statistic == "first-goal" else f"{value:.3f}") in text


def test_the_command_shows_a_statistic(
    grid_7x7: list[RunRecord], write_runs: Callable[[list[RunRecord]], Path], capsys: pytest.CaptureFixture[str]
) -> None:
    root = str(write_runs(grid_7x7))
    assert main(["table", root, "--statistic", "solved", "--format", "md"]) == 0
    assert "### Share of solved seeds: suite grid-7x7, version 1" in capsys.readouterr().out
    assert main(["table", root, "--statistic", "solve"]) != 0
    assert "did you mean 'solved'" in capsys.readouterr().err


def test_the_oracles_scale_as_a_frame(grid_7x7: list[RunRecord], write_runs: Callable[[list[RunRecord]], Path]) -> None:
    frame = frames.oracle_normalized(write_runs(grid_7x7))
    told = frame.loc["grid-7x7", "KeyDoors-7x7", "ppo", 0]
    assert told["auc"] == pytest.approx(0.6 / ORACLES["SPRL/KeyDoors-7x7-v1"])
