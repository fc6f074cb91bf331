"""Tables: what stands in them by hand, what is refused, and that the five formats say the same."""

from __future__ import annotations

import csv
import io
import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from sprl_bench import scores
from sprl_bench.records import RunRecord, RunSpec
from sprl_bench.suite import expand
from sprl_bench.tables import (
    BOOTSTRAP_SEED,
    FORMATS,
    IncomparableError,
    MissingRunsError,
    Result,
    Table,
    check_comparable,
    render,
    tabulate,
)
from sprl_bench.tables.render import interval_text, sparkline
from sprl_bench.tables.text_table import number
from sprl_bench.tasks import find_suite

MakeRecord = Callable[..., RunRecord]
FOUR, KEY = "FourRooms-7x7", "KeyDoors-7x7"


TRIAL = "This suite is for trying things out; its budgets are too small to rank agents."


def told(table: Table) -> tuple[str, ...]:
    """Return the notes of a table of the suite `smoke`, but for the one that all of them have."""
    return tuple(note for note in table.notes if note != TRIAL)


def test_means_and_seeds_by_hand(grid_7x7: list[RunRecord]) -> None:
    [table] = tabulate(grid_7x7)
    assert (table.suite, table.suite_version, table.tasks, table.notes) == ("grid-7x7", 1, (FOUR, KEY), ())
    assert [row.agent for row in table.rows] == ["ppo", "random"]
    ppo = table.rows[0]
    # Flat curves at 0.50, 0.51, ... 0.54 on the one task and 0.1 more on the other.
    assert ppo.seeds == (0, 1, 2, 3, 4)
    assert [cell.auc.value for cell in ppo.cells if cell.auc] == pytest.approx([0.52, 0.62])
    assert ppo.auc is not None
    assert ppo.auc.value == pytest.approx(0.57)
    assert ppo.auc.seeds == 5
    assert ppo.auc_iqm is not None
    # Of ten numbers two go on each side: 0.52, 0.53, 0.54, 0.60, 0.61, 0.62 are left.
    assert ppo.auc_iqm.value == pytest.approx((0.52 + 0.53 + 0.54 + 0.60 + 0.61 + 0.62) / 6)
    assert ppo.cells[0].steps_to_threshold == (5_000,) * 5  # a hundredth of the budget
    assert table.rows[1].cells[0].steps_to_threshold == (None,) * 5
    assert ppo.auc.interval is not None
    assert 0.55 < ppo.auc.interval.low < 0.57 < ppo.auc.interval.high < 0.59


def test_final_and_success_have_their_own_columns(make_record: MakeRecord) -> None:
    curve, success = [0.0] * 90 + [0.8] * 10, [0.0] * 50 + [1.0] * 50
    record = make_record(curve=curve)
    scores = record.scores.model_copy(update={"success_auc": 0.5, "success_final": 1.0})
    [table] = tabulate([make_record(curve=curve, success_curve=tuple(success), scores=scores)])
    row = table.rows[0]
    assert row.auc is not None
    assert row.final is not None
    assert row.success_auc is not None
    assert row.success_final is not None
    assert (row.auc.value, row.final.value) == pytest.approx((0.08, 0.8))
    assert (row.success_auc.value, row.success_final.value) == (0.5, 1.0)


def test_the_same_records_give_the_same_bytes_in_any_order(grid_7x7: list[RunRecord]) -> None:
    forward, backward = tabulate(grid_7x7), tabulate(reversed(grid_7x7))
    for form in FORMATS:
        assert render(forward, form) == render(backward, form)


def test_intervals_come_from_the_documented_seed(make_record: MakeRecord) -> None:
    levels = np.random.default_rng(0).random(7)
    records = [make_record(seed=seed, level=level) for seed, level in enumerate(levels)]
    row = tabulate(records)[0].rows[0]
    for estimate, statistic in ((row.auc, scores.mean), (row.auc_iqm, scores.iqm)):
        expected = scores.bootstrap_interval(
            np.asarray([[record.scores.auc] for record in records]), statistic, np.random.default_rng(BOOTSTRAP_SEED)
        )
        assert estimate is not None
        assert estimate.interval == expected


def test_another_agent_changes_no_other_row(grid_7x7: list[RunRecord]) -> None:
    [both] = tabulate(grid_7x7)
    [alone] = tabulate([record for record in grid_7x7 if record.spec.agent == "random"])
    assert alone.rows[0] == both.rows[1]


def test_a_missing_run_is_named_and_nothing_averaged(grid_7x7: list[RunRecord]) -> None:
    lacking = [record for record in grid_7x7 if (record.spec.task.name, record.spec.seed) != (KEY, 3)]
    with pytest.raises(MissingRunsError, match=rf"2 runs are missing: {KEY}/ppo/seed-3, {KEY}/random/seed-3\."):
        tabulate(lacking)


def test_missing_runs_are_shown_and_marked_when_allowed(grid_7x7: list[RunRecord]) -> None:
    lacking = [
        record for record in grid_7x7 if (record.spec.agent, record.spec.task.name, record.spec.seed) != ("ppo", KEY, 4)
    ]
    [table] = tabulate(lacking, allow_missing=True)
    ppo, random = table.rows
    assert (ppo.complete, random.complete) == (False, True)
    assert ppo.seeds == (0, 1, 2, 3)
    assert [cell.missing for cell in ppo.cells] == [(), (4,)]
    assert ppo.cells[0].auc is not None
    assert ppo.cells[0].auc.value == pytest.approx(0.52)  # all five
    assert ppo.auc is not None
    assert ppo.auc.value == pytest.approx((0.515 + 0.615) / 2)  # the four seeds that both tasks have
    text = render([table], "md")
    assert "| ppo ‡ | 4 |" in text
    assert "4 of 5" in text
    assert f"1 run is missing: {KEY}/ppo/seed-4." in text
    assert "| random | 5 |" in text


def test_a_task_that_nobody_ran_is_missing_too(grid_7x7: list[RunRecord]) -> None:
    one_task = [record for record in grid_7x7 if record.spec.task.name == FOUR]
    with pytest.raises(MissingRunsError, match=r"10 runs are missing: .* and 2 more\."):
        tabulate(one_task)
    [table] = tabulate(one_task, tasks=[FOUR])
    assert table.tasks == (FOUR,)
    [shown] = tabulate(one_task, allow_missing=True)
    assert shown.rows[0].auc is None
    assert "| ppo ‡ | 0 | 0.520" in render([shown], "md")


def test_an_incomplete_record_is_a_missing_run(make_record: MakeRecord) -> None:
    records = [make_record(seed=0), make_record(seed=1, status="incomplete")]
    with pytest.raises(MissingRunsError, match="1 run is missing: FourRooms-7x7/ppo/seed-1"):
        tabulate(records)
    with pytest.raises(MissingRunsError, match="no finished run"):
        tabulate(records[1:])


def test_a_planned_run_without_a_record_is_missing(make_record: MakeRecord) -> None:
    records = [make_record(seed=seed) for seed in range(3)]
    with pytest.raises(MissingRunsError, match="seed-2"):
        tabulate(records[:2], planned=[record.spec for record in records])
    assert tabulate(records, planned=[record.spec for record in records]) == tabulate(records)


def test_an_agent_that_finished_nothing_keeps_its_row(make_record: MakeRecord) -> None:
    planned = [make_record("gt-sprl", privileged=True).spec]
    with pytest.raises(MissingRunsError, match="gt-sprl/seed-0"):
        tabulate([make_record()], planned=planned)
    [table] = tabulate([make_record()], planned=planned, allow_missing=True)
    assert [(row.agent, row.privileged, row.auc is None) for row in table.rows] == [
        ("ppo", False, False),
        ("gt-sprl", True, True),
    ]


def test_a_suite_in_which_nothing_finished_is_missing(make_record: MakeRecord) -> None:
    planned = [make_record(suite="grid").spec]
    lost = r"No run is finished of grid; 1 run is missing: FourRooms-7x7/ppo/seed-0\."
    with pytest.raises(MissingRunsError, match=lost + r" Finish them .* allow missing runs \(--allow-missing\)"):
        tabulate([make_record()], planned=planned)
    [table] = tabulate([make_record()], planned=planned, allow_missing=True)
    assert re.fullmatch(lost, table.notes[-1])


def test_there_is_one_table_a_suite_and_one_a_custom_task(make_record: MakeRecord, grid_7x7: list[RunRecord]) -> None:
    changes = [{"name": f"FourRooms-7x7-{budget}", "budget": budget} for budget in (1_000, 2_000)]
    custom = [make_record(suite_version=0, task_changes=change) for change in changes]
    custom = [
        record.model_copy(update={"spec": record.spec.model_copy(update={"suite": "custom"})}) for record in custom
    ]
    tables = tabulate([make_record(), *grid_7x7, *custom])
    assert [(table.suite, table.tasks) for table in tables] == [
        ("custom", ("FourRooms-7x7-1000",)),
        ("custom", ("FourRooms-7x7-2000",)),
        ("grid-7x7", (FOUR, KEY)),
        ("smoke", (FOUR,)),
    ]
    assert "not comparable with published scores" in tables[0].notes[0]
    assert tables[3].notes == (TRIAL,)
    with pytest.raises(MissingRunsError, match=r"No run is finished of custom/FourRooms-7x7-2000;"):
        tabulate(custom[:1], planned=[record.spec for record in custom])
    assert tabulate(custom[:1], planned=[record.spec for record in custom], tasks=["FourRooms-7x7-1000"])
    assert [table.suite for table in tabulate([make_record(), *grid_7x7], tasks=[KEY])] == ["grid-7x7"]


def test_agents_can_be_chosen(grid_7x7: list[RunRecord], make_record: MakeRecord) -> None:
    [table] = tabulate(grid_7x7, agents=["random"])
    assert [row.agent for row in table.rows] == ["random"]
    spec = make_record(seed=7, suite="grid-7x7").spec
    assert tabulate(grid_7x7, agents=["random"], planned=[spec]) == [table]  # another agent's hole does not matter
    with pytest.raises(MissingRunsError):
        tabulate(grid_7x7, agents=["ppo"], planned=[spec])
    with pytest.raises(ValueError, match="Unknown agent among these runs: 'randon'; did you mean 'random'"):
        tabulate(grid_7x7, agents=["randon"])


def test_an_unknown_task_is_refused_with_a_suggestion(grid_7x7: list[RunRecord]) -> None:
    with pytest.raises(ValueError, match="did you mean 'KeyDoors-7x7'"):
        tabulate(grid_7x7, tasks=["KeyDoor-7x7"])


def test_one_seed_has_a_dash_for_an_interval(make_record: MakeRecord) -> None:
    tables = tabulate([make_record()])
    assert "| ppo | 1 | 0.500 - | 0.500 - | 0.500 - |" in render(tables, "md")
    [line] = [line for line in render(tables, "csv").splitlines() if ",all,auc," in line]
    assert line == "smoke,2,ppo,false,all,auc,0.500000,,,1,0,"
    assert json.loads(render(tables, "json"))[0]["rows"][0]["auc"] == {"value": 0.5, "interval": None, "seeds": 1}


@pytest.mark.parametrize("form", FORMATS)
def test_what_else_an_agent_uses_is_marked_in_every_format(form: str, make_record: MakeRecord) -> None:
    run = make_record("her")
    spec = run.spec.model_copy(update={"information": ("relabelling", "shaped")})
    text = render(tabulate([run.model_copy(update={"spec": spec}), make_record("ppo")]), form)
    assert "relabelling" in text
    assert "shaped" in text
    if form in ("md", "rich", "latex"):
        assert "her (relabelling, shaped)" in " ".join(text.split())
        assert "asks for the reward of goals" in text
    with pytest.raises(IncomparableError, match="agent her: information differs"):
        tabulate([run.model_copy(update={"spec": spec}), make_record("her", seed=1)])


@pytest.mark.parametrize("form", FORMATS)
def test_privileged_agents_are_marked_in_every_format(form: str, make_record: MakeRecord) -> None:
    text = render(tabulate([make_record("gt-grid", privileged=True), make_record("ppo")]), form)
    if form == "json":
        assert [row["privileged"] for row in json.loads(text)[0]["rows"]] == [True, False]
    elif form == "csv":
        assert {(row["agent"], row["privileged"]) for row in csv.DictReader(io.StringIO(text))} == {
            ("gt-grid", "true"),
            ("ppo", "false"),
        }
    else:
        dagger = r"$^\dagger$" if form == "latex" else "†"
        assert f"gt-grid {dagger}" in text
        assert f"ppo {dagger}" not in text
        assert f"{dagger} privileged: sees what an ordinary agent does not." in text


@pytest.mark.parametrize("form", ["rich", "md", "latex"])
def test_what_a_person_reads_holds_the_numbers(form: str, grid_7x7: list[RunRecord]) -> None:
    [table] = tabulate(grid_7x7)
    text = render([table], form)
    assert table.rows[0].auc is not None
    assert table.rows[0].auc.interval is not None
    low, high = table.rows[0].auc.interval
    for part in ("0.520", "0.620", "0.570", f"[{low:.3f}, {high:.3f}]", "Mean AUC", "IQM", "Seeds", "Success"):
        assert part in text
    assert text.endswith("\n")
    assert not text.endswith("\n\n")


def test_csv_has_a_line_for_each_number(grid_7x7: list[RunRecord]) -> None:
    lines = list(csv.DictReader(io.StringIO(render(tabulate(grid_7x7), "csv"))))
    assert len(lines) == 2 * (2 * 4 + 5)
    chosen = [line for line in lines if (line["agent"], line["task"], line["measure"]) == ("random", KEY, "auc")]
    assert [(line["value"], line["seeds"], line["missing"]) for line in chosen] == [("0.220000", "5", "0")]


def test_json_holds_the_whole_table(grid_7x7: list[RunRecord]) -> None:
    [table] = tabulate(grid_7x7)
    [data] = json.loads(render([table], "json"))
    assert data["rows"][0]["cells"][1]["auc"]["value"] == 0.62
    assert data["rows"][0]["cells"][0]["steps_to_threshold"] == [5_000] * 5
    assert type(table).model_fields.keys() == data.keys()


def test_rich_is_plain_without_a_terminal_and_fits_one(
    grid_7x7: list[RunRecord], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TERM", "xterm")
    tables = tabulate(grid_7x7)
    assert "\x1b" not in render(tables, "rich")
    assert "\x1b" in render(tables, "rich", width=100)
    narrow = render(tables, "rich", width=82)
    assert "FourRooms-" in narrow
    assert "…" not in narrow


def test_names_cannot_break_out_of_a_table(make_record: MakeRecord) -> None:
    tables = tabulate([make_record("a&b [red]$x$ {y}_z% [l](u)")])
    assert r"| a&b [red]$x$ {y}_z% [l]\(u) | 1 |" in render(tables, "md")
    assert r"a\&b [red]\$x\$ \{y\}\_z\% [l](u) & 1" in render(tables, "latex")
    assert "a&b [red]$x$ {y}_z% [l](u)" in render(tables, "rich")


def test_an_unknown_format_is_refused(grid_7x7: list[RunRecord]) -> None:
    with pytest.raises(ValueError, match=r"Unknown format 'markdown'.*llowed: csv, json, latex, md, rich"):
        render(tabulate(grid_7x7), "markdown")


def test_a_negative_nought_is_nought() -> None:
    assert number(-0.0001) == "0.000"
    assert (number(-0.0001, "+"), number(0.0126, "+"), number(-0.5, "+")) == ("+0.000", "+0.013", "-0.500")


MIXED = {
    "version": ({"suite_version": 7}, r"suite 'smoke': version differs: 2 \(ppo\), 7 \(icm\)"),
    "budget": ({"task_changes": {"budget": 10_000}}, r"FourRooms-7x7: budget differs: 10000 \(icm\), 100000 \(ppo\)"),
    "arguments": ({"task_changes": {"arguments": {"substep": 3}}}, r"arguments differs: .*\(substep=3\).* \(icm\)"),
    "environment": ({"task_changes": {"env_id": "SPRL/FourRooms-7x7-v2"}}, r"environment and arguments differs"),
    "range": ({"task_changes": {"score_range": (0.0, 2.0)}}, r"returns in \[0, 2\]"),
    "fingerprint": ({"fingerprint": "other"}, r"environment fingerprint differs: [0-9a-f]{16} \(ppo\), other \(icm\)"),
}


@pytest.mark.parametrize("what", MIXED)
def test_what_is_not_comparable_is_refused(what: str, make_record: MakeRecord) -> None:
    changes, message = MIXED[what]
    with pytest.raises(IncomparableError, match=message):
        tabulate([make_record("ppo"), make_record("icm", **changes)])


def test_an_agent_is_privileged_on_all_tasks_or_on_none(make_record: MakeRecord) -> None:
    tasks = ("FourRooms-7x7", False), ("KeyDoors-7x7", True)
    with pytest.raises(IncomparableError, match=r"agent ppo: privileged differs: False \(ppo\), True \(ppo\)"):
        tabulate([make_record("ppo", task, suite="grid-7x7", privileged=seen) for task, seen in tasks])


def test_a_hyperparameter_that_is_null_is_not_one_that_is_absent(make_record: MakeRecord) -> None:
    def runs(*values: dict[str, Any]) -> list[RunRecord]:
        return [make_record(seed=seed, hyperparameters=value) for seed, value in enumerate(values)]

    with pytest.raises(IncomparableError, match="seeds differ in the hyperparameter k: null, none given"):
        tabulate(runs({"k": None}, {}))
    assert tabulate(runs({"k": {"a": 1, "b": 2}}, {"k": {"b": 2, "a": 1}}))


def test_builds_devices_and_surroundings_that_differ_are_told(make_record: MakeRecord) -> None:
    def notes(*changes: dict[str, Any], agents: str = "aa") -> tuple[str, ...]:
        return told(tabulate([make_record(agents[seed], seed=seed, **one) for seed, one in enumerate(changes)])[0])

    one, two = "1" * 40, "2" * 40
    assert notes({"git_commit": one}, {"git_commit": one}) == ()
    assert notes({"git_commit": one}, {"git_commit": f"{one}, {two}-dirty"}) == (
        "Different builds of sprl-bench: 1111111111 (a), 1111111111, 2222222222-dirty (a).",
    )
    assert notes({"git_commit": one}, {}, agents="ab") == (
        "Different builds of sprl-bench: 1111111111 (a), no checkout (b).",
    )
    assert notes({"git_commit": f"{one}, 6 others, {two}"}) == ()
    assert notes({"git_commit": f"{two}-dirty"}) == ("Made with a changed checkout of sprl-bench: 2222222222-dirty.",)
    versions = {"numpy": "2.4.6", "sprl-bench": "0.1.0"}
    assert notes({"versions": {**versions, "python": "3.11.7"}}, {"versions": {**versions, "python": "3.12.1"}}) == (
        "Different versions of python: 3.11.7 (a), 3.12.1 (a).",
    )
    here, there = make_record("a", seed=0), make_record("a", seed=1)
    there = there.model_copy(update={"spec": there.spec.model_copy(update={"device": "cuda:1"})})
    assert told(tabulate([here, there])[0]) == ("Different devices: cpu (a), cuda (a).",)


def test_seeds_of_other_hyperparameters_are_refused(make_record: MakeRecord) -> None:
    with pytest.raises(
        IncomparableError, match=r"agent ppo: seeds differ in the hyperparameter learning_rate: 0\.001, 0\.1\."
    ):
        tabulate([make_record(seed=0), make_record(seed=1, hyperparameters={"learning_rate": 0.1})])
    assert tabulate([make_record("ppo"), make_record("icm", hyperparameters={"learning_rate": 0.1})])


def test_an_agent_is_privileged_or_not(make_record: MakeRecord) -> None:
    with pytest.raises(IncomparableError, match="privileged differs"):
        tabulate([make_record(seed=0), make_record(seed=1, privileged=True)])


def test_a_run_that_is_there_twice_is_refused(make_record: MakeRecord) -> None:
    with pytest.raises(IncomparableError, match="agent ppo: seed 0 is given 2 times"):
        tabulate([make_record(), make_record(level=0.6)])


def test_other_numbers_of_sub_environments_are_said_aloud(make_record: MakeRecord) -> None:
    few, many = make_record("ppo"), make_record("icm")
    many = many.model_copy(update={"spec": many.spec.model_copy(update={"num_envs": 256})})
    [table] = tabulate([few, many])
    assert told(table) == ("Different numbers of sub-environments, which moves scores: 12 (ppo), 256 (icm).",)
    other = many.model_copy(update={"spec": many.spec.model_copy(update={"num_envs": 12, "seed": 1})})
    with pytest.raises(IncomparableError, match=r"agent icm: num_envs differs: 12 \(icm\), 256 \(icm\)"):
        tabulate([many, other])


def test_an_agents_changed_code_is_said_aloud(make_record: MakeRecord) -> None:
    records = [make_record("ppo", seed=seed, agent_code=code) for seed, code in enumerate(("aa", "bb", "aa"))]
    assert tabulate(records)[0].notes[0] == "The code of ppo changed between its runs: aa, bb."
    assert not [note for note in tabulate([records[0], records[2]])[0].notes if "code" in note]
    assert not [note for note in tabulate([records[0], make_record("icm", agent_code="cc")])[0].notes if "code" in note]


def test_many_abandoned_episodes_are_said_aloud(make_record: MakeRecord) -> None:
    def left(number: int, seed: int) -> RunRecord:
        record = make_record("ppo", seed=seed)
        return record.model_copy(update={"totals": record.totals.model_copy(update={"abandoned": number})})

    assert told(tabulate([left(1, 0), left(0, 1)])[0]) == ()
    note = "ppo reset up to 12% of a run's episodes before their end on FourRooms-7x7; they count as failures."
    assert told(tabulate([left(12, 0), left(3, 1)])[0]) == (note,)


def test_runs_in_which_no_episode_ended_are_said_to_say_nothing(make_record: MakeRecord) -> None:
    record = make_record("ppo", level=0.0)
    empty = record.model_copy(update={"totals": record.totals.model_copy(update={"episodes": 0})})
    note = (
        "ppo: no episode on FourRooms-7x7 ended within a run's budget, so its score is 0 by default and no measurement."
    )
    assert tabulate([make_record("icm"), empty])[0].notes == (note, TRIAL)
    assert told(tabulate([make_record("icm"), record])[0]) == ()


def test_runs_that_have_begun_are_told_from_those_that_have_not(make_record: MakeRecord) -> None:
    planned = [make_record("ppo", seed=seed).spec for seed in range(4)]
    statuses = {planned[seed].path(Path()): status for seed, status in ((1, "running"), (2, "interrupted"))}
    with pytest.raises(MissingRunsError, match=r"3 runs are missing: .* \(1 running, 1 interrupted\)\. Finish them"):
        tabulate([make_record("ppo")], planned=planned, statuses=statuses)


def test_other_package_versions_are_said_aloud(make_record: MakeRecord) -> None:
    versions = {"numpy": "2.4.6", "torch": "2.13.0", "rich": "15.0"}
    records = [make_record("ppo", versions=versions), make_record("icm", versions={**versions, "numpy": "2.3"})]
    [table] = tabulate(records)
    assert told(table) == ("Different versions of numpy: 2.3 (icm), 2.4.6 (ppo).",)
    assert "Different versions of numpy" in render([table], "latex")
    # What one of them did not load, and what no number depends on, does not matter.
    assert told(tabulate([make_record("ppo", versions=versions), make_record("icm", versions={"rich": "14"})])[0]) == ()


def test_another_simulator_is_refused(make_record: MakeRecord) -> None:
    records = [make_record(agent, versions={"mujoco": release}) for agent, release in (("a", "3.11"), ("b", "3.12"))]
    with pytest.raises(IncomparableError, match=r"version of mujoco differs: 3\.11 \(a\), 3\.12 \(b\)"):
        tabulate(records)


def test_a_budget_that_is_not_the_suites_is_said_aloud(make_record: MakeRecord) -> None:
    notes = check_comparable([Result.of(make_record(task_changes={"budget": 500}))])
    assert notes == [
        "FourRooms-7x7: a budget of 500 environment steps instead of the suite's 100,000; not comparable with "
        "published scores.",
        TRIAL,
    ]
    notes = check_comparable([Result.of(make_record(suite_version=7))])
    assert notes == ["Version 7 of the suite; the one installed is 2."]


def test_each_column_holds_its_own_figure(rising: list[RunRecord]) -> None:
    [table] = tabulate(rising)
    [row] = table.rows
    [cell] = row.cells
    for name in ("auc", "final", "success_auc", "success_final"):
        mean = np.mean([getattr(record.scores, name) for record in rising])
        assert getattr(row, name).value == getattr(cell, name).value == pytest.approx(mean)
    shown = [cell.auc, row.auc, row.auc_iqm, row.final, row.success_final]
    assert len({number(figure.value) for figure in shown}) == 4  # of one task, the whole and the cell are one
    texts = [f"{number(figure.value)} {interval_text(figure.interval)}" for figure in shown]
    assert f"| rising | 5 | {' | '.join(texts)} |" in render([table], "md")
    for line in csv.DictReader(io.StringIO(render([table], "csv"))):
        held = getattr(row if line["task"] == "all" else cell, line["measure"])
        figures = [float(line[column]) for column in ("value", "low", "high")]
        assert figures == pytest.approx([held.value, *held.interval], abs=1e-6)


def test_a_terminal_shows_the_mean_learning_curve_and_other_formats_do_not(rising: list[RunRecord]) -> None:
    (table,) = tabulate(rising)
    curve = np.mean([run.return_curve for run in rising], axis=0)
    expected = [part.mean() for part in np.array_split(curve, 8)]
    assert table.rows[0].cells[0].trend == pytest.approx(expected)
    assert sparkline(table.rows[0].cells[0].trend) in render([table], "rich")
    for form in ("md", "csv", "latex", "json"):
        assert "▁" not in render([table], form)
        assert "trend" not in render([table], form)


def test_a_sparkline_stays_within_its_blocks() -> None:
    assert sparkline([-1.0, 0.0, 0.49, 0.51, 1.0, 7.0]) == "▁▁▄▅██"


# ---------------------------------------------------------------------------------------------- variants

levels = st.lists(st.floats(0, 1), min_size=2, max_size=4)


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])  # it only makes records
@given(scores_by_k=st.dictionaries(st.sampled_from([1, 3, 5]), levels, min_size=1))
def test_variants_in_one_table_have_the_rows_of_tables_of_their_own(
    make_record: MakeRecord, scores_by_k: dict[int, list[float]]
) -> None:
    """A variant's row is the one that the same runs have where `--set` gave them the plain name."""
    together, alone = [], []
    for k, of_seeds in scores_by_k.items():
        (variant,) = expand(find_suite("smoke"), [f"sprl+k={k}"], [0])
        (plain,) = expand(find_suite("smoke"), ["sprl"], [0], overrides={"k": k})
        runs = [make_record("sprl", seed=seed, level=level) for seed, level in enumerate(of_seeds)]
        together += [_as(run, variant) for run in runs]
        [table] = tabulate([_as(run, plain) for run in runs])
        alone.append(table.rows[0].model_copy(update={"agent": variant.agent}))
    [table] = tabulate(together)
    assert sorted(table.rows, key=lambda row: row.agent) == sorted(alone, key=lambda row: row.agent)


def _as(run: RunRecord, spec: RunSpec) -> RunRecord:
    """Return the run under another spec, with its own task and seed."""
    return run.model_copy(update={"spec": spec.model_copy(update={"task": run.spec.task, "seed": run.spec.seed})})
