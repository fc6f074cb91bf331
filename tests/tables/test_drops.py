"""The line under a table that says what is left out, and why."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from sprl_bench import records
from sprl_bench.cli import main
from sprl_bench.records import RunRecord, RunSpec
from sprl_bench.records.folder import ERROR, METRICS, SPEC
from sprl_bench.tables import FORMATS, IncomparableError, render, tabulate
from sprl_bench.tables.drops import Drop

MakeRecord = Callable[..., RunRecord]
FOUR, KEY = "FourRooms-7x7", "KeyDoors-7x7"


def last_line(runs: list[RunRecord], **rest: object) -> str:
    return render(tabulate(runs, **rest), "md").rstrip().splitlines()[-1]  # type: ignore[arg-type]


@pytest.mark.parametrize("form", sorted(set(FORMATS) - {"csv"}))
def test_every_table_has_the_line(form: str, grid_7x7: list[RunRecord]) -> None:
    text = render(tabulate(grid_7x7), form)
    assert ('"planned": 20' if form == "json" else "Drops: none; the table has all 20 planned runs.") in text


def test_a_single_run_is_no_plural(make_record: MakeRecord) -> None:
    assert last_line([make_record()]) == "- Drops: none; the table has the 1 planned run."


def test_each_drop_has_its_reason(grid_7x7: list[RunRecord], make_record: MakeRecord) -> None:
    stopped = make_record("ppo", FOUR, 5, suite="grid-7x7", status="incomplete")
    planned = [make_record("icm", FOUR, seed, suite="grid-7x7").spec for seed in range(2)]
    statuses = {planned[0].path(Path()): "failed", planned[1].path(Path()): "waiting"}
    [table] = tabulate([*grid_7x7, stopped], planned=planned, allow_missing=True, statuses=statuses)
    assert table.planned == 20 + 2 + 4
    assert table.drops == (
        Drop(agent="icm", task=FOUR, seed=0, reason="failed"),
        Drop(agent="ppo", task=FOUR, seed=5, reason="interrupted"),
        Drop(agent="icm", task=FOUR, seed=1, reason="missing"),
        Drop(agent="icm", task=KEY, seed=0, reason="missing"),
        Drop(agent="icm", task=KEY, seed=1, reason="missing"),
        Drop(agent="ppo", task=KEY, seed=5, reason="missing"),
    )
    assert (
        render([table], "md")
        .rstrip()
        .endswith(
            f"- Drops: 6 of 26 planned runs: 1 failed ({FOUR}/icm/seed-0); 1 interrupted ({FOUR}/ppo/seed-5); "
            f"4 missing ({FOUR}/icm/seed-1, {KEY}/icm/seed-0, {KEY}/icm/seed-1, 1 more)."
        )
    )


@pytest.mark.parametrize(
    "change",
    [{"fingerprint": "other"}, {"task_changes": {"budget": 9}}, {"suite_version": 1}],
    ids=lambda change: next(iter(change)),
)
def test_runs_of_another_environment_than_most_are_left_out_where_that_is_allowed(
    change: dict[str, object], make_record: MakeRecord
) -> None:
    runs = [*(make_record("ppo", seed=seed) for seed in range(3)), make_record("icm", **change)]
    with pytest.raises(IncomparableError):
        tabulate(runs, allow_missing=True)
    [table] = tabulate(runs, allow_missing=True, drop_incomparable=True)
    assert (table.planned, table.drops) == (4, (Drop(agent="icm", task=FOUR, seed=0, reason="incomparable"),))
    assert [(row.agent, row.seeds) for row in table.rows] == [("ppo", (0, 1, 2))]
    assert tabulate(runs[:3], drop_incomparable=True) == tabulate(runs[:3])


def test_runs_of_another_simulator_are_left_out_but_not_those_without(make_record: MakeRecord) -> None:
    versions = [{"mujoco": "3.1"}, {"mujoco": "3.1"}, {"mujoco": "3.2"}, {"numpy": "2.0"}]
    runs = [make_record(agent, versions=one) for agent, one in zip("abcd", versions, strict=True)]
    [table] = tabulate(runs, drop_incomparable=True, allow_missing=True)
    assert table.drops == (Drop(agent="c", task=FOUR, seed=0, reason="incomparable"),)
    assert [row.agent for row in table.rows if row.auc] == ["a", "b", "d"]


def test_what_one_agent_may_not_mix_is_refused_all_the_same(make_record: MakeRecord) -> None:
    runs = [make_record(seed=0), make_record(seed=1, hyperparameters={"learning_rate": 0.1})]
    with pytest.raises(IncomparableError, match="seeds differ in the hyperparameter"):
        tabulate(runs, allow_missing=True, drop_incomparable=True)


def test_the_command_knows_what_failed(
    make_record: MakeRecord, write_runs: Callable[[list[RunRecord]], Path], capsys: pytest.CaptureFixture[str]
) -> None:
    root = write_runs([make_record(seed=0), make_record("icm", fingerprint="other")])
    for seed, file in ((1, ERROR), (2, METRICS)):
        folder = _begun(make_record(seed=seed).spec, root)
        (folder / file).write_text('{"env_steps": 12, "wall_time_s": 1.0}\n')
    assert main(["table", str(root), "--format", "md"]) != 0
    assert main(["table", str(root), "--format", "md", "--allow-missing"]) == 0
    assert (
        "Drops: 3 of 4 planned runs: 1 failed (FourRooms-7x7/ppo/seed-1); 1 interrupted (FourRooms-7x7/ppo/seed-2); "
        "1 incomparable (FourRooms-7x7/icm/seed-0)."
    ) in capsys.readouterr().out


def _begun(spec: RunSpec, root: Path) -> Path:
    folder = spec.path(root)
    folder.mkdir(parents=True)
    records.write(folder / SPEC, spec)
    return folder
