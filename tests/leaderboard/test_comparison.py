"""Comparisons of runs with a leaderboard: what is compared, what is refused, and what is told beside it."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from sprl_bench import leaderboard
from sprl_bench.leaderboard.comparison import p_text
from sprl_bench.records import RunRecord
from sprl_bench.tables import IncomparableError, MissingRunsError

MakeRecord = Callable[..., RunRecord]
FOUR, KEY = "FourRooms-7x7", "KeyDoors-7x7"


def test_a_comparison_by_hand(home: Path, make_record: MakeRecord) -> None:
    mine = [
        make_record("mine", task, seed, suite="grid-7x7", level=level + 0.01 * seed)
        for task, level in ((FOUR, 0.7), (KEY, 0.5))
        for seed in range(5)
    ]
    ppo, random = leaderboard.compare(mine, leaderboard.find_entries(home / "grid-7x7"))
    assert (ppo.agent, ppo.entry, ppo.seeds, ppo.entry_seeds) == ("mine", "ppo", 5, 5)
    assert [difference.task for difference in ppo.tasks] == [FOUR, KEY]
    # Mine are 0.72 and 0.52 on average, the entry's 0.52 and 0.62.
    assert [difference.difference for difference in ppo.tasks] == pytest.approx([0.2, -0.1])
    assert (ppo.overall.runs, ppo.overall.entry) == pytest.approx((0.62, 0.57))
    assert ppo.overall.difference == pytest.approx(0.05)
    interval = ppo.overall.interval
    assert interval is not None
    assert 0.03 < interval.low < 0.05 < interval.high < 0.07
    assert random.overall.difference == pytest.approx(0.45)
    assert ppo.notes == ()


def test_a_p_value_and_a_probability_of_improvement_stand_beside_every_difference(
    home: Path, make_record: MakeRecord
) -> None:
    mine = [
        make_record("mine", task, seed, suite="grid-7x7", level=level + 0.01 * seed)
        for task, level in ((FOUR, 0.52), (KEY, 0.9))
        for seed in range(5)
    ]
    [ppo] = leaderboard.compare(mine, leaderboard.find_entries(home / "grid-7x7")[:1])
    four, key = ppo.tasks
    # 0.52 to 0.56 against 0.50 to 0.54: of 25 pairs 19 are won and 3 tied.
    assert four.improvement == pytest.approx((19 + 3 / 2) / 25)
    # 0.90 to 0.94 against 0.60 to 0.64: of 252 ways, only this one and its mirror.
    assert (key.p_value, key.improvement) == (2 / 252, 1.0)
    assert key.improvement_interval == (1.0, 1.0)
    assert ppo.overall.improvement == pytest.approx((four.improvement + 1) / 2)
    assert ppo.overall.p_value < key.p_value
    text = leaderboard.render_comparisons([ppo], "md")
    assert "p 0.008, 100%" in text
    assert [p_text(value) for value in (1.0, 2 / 252, 0.0006, 0.0004)] == ["1.000", "0.008", "0.001", "< 0.001"]
    assert "two-sided permutation test, stratified by task" in text


def test_a_comparison_says_which_tasks_it_is_of(home: Path, grid_7x7: list[RunRecord]) -> None:
    entries = leaderboard.find_entries(home / "grid-7x7")
    one_task = [record for record in grid_7x7 if record.spec.task.name == KEY]
    for compared in (
        leaderboard.compare(one_task, entries, agent="random"),
        leaderboard.compare(grid_7x7, entries, agent="random", tasks=[KEY]),
    ):
        assert [one.entry for one in compared] == ["ppo", "random"]
        assert [difference.task for difference in compared[0].tasks] == [KEY]
        assert compared[0].overall.difference == compared[0].tasks[0].difference == pytest.approx(-0.4)
        assert compared[0].notes == (f"1 of the suite's 2 tasks are compared: {KEY}.",)


def test_every_agent_is_compared_unless_one_is_named(home: Path, grid_7x7: list[RunRecord]) -> None:
    compared = leaderboard.compare(grid_7x7, leaderboard.find_entries(home / "grid-7x7"))
    assert [(one.agent, one.entry) for one in compared] == [
        ("ppo", "ppo"),
        ("ppo", "random"),
        ("random", "ppo"),
        ("random", "random"),
    ]


def test_a_comparison_of_one_seed_has_no_interval(home: Path, grid_7x7: list[RunRecord]) -> None:
    first = [record for record in grid_7x7 if record.spec.seed == 0]
    compared = leaderboard.compare(first, leaderboard.find_entries(home / "grid-7x7"), agent="ppo")
    assert compared[0].overall.interval is None
    text = leaderboard.render_comparisons(compared, "md")
    assert "### ppo (1 seed, mean AUC 0.550) minus each entry" in text
    # 0.50 against 0.50 to 0.54: of the six ways to choose one, three are as far from the mean of the others.
    assert "| ppo | 5 | 0.570 | -0.020 - p 0.500, 10% | -0.020 - p 0.500, 10% | " in text
    assert "A single seed has no interval (-)." in text


def test_a_comparison_says_where_the_entry_holds_the_very_runs(
    home: Path, grid_7x7: list[RunRecord], make_record: MakeRecord
) -> None:
    def run(task: str, seed: int) -> RunRecord:
        return make_record("ppo", task, seed, suite="grid-7x7", curve=[0.1] * 50 + [0.5 + 0.01 * seed] * 50)

    runs = [run(task, seed) for task in (FOUR, KEY) for seed in range(6)]
    first = [one for one in runs if one.spec.seed < 5]
    entry = leaderboard.make_entry(first, agent="ppo", authors=["Ada L."], link="https://example.org/paper_1")
    [random] = [other for other in leaderboard.find_entries(home / "grid-7x7") if other.agent == "random"]
    against_ppo, against_random = leaderboard.compare(runs, [entry, random])
    assert against_ppo.notes == ("ppo's entry holds these very runs: seeds 0, 1, 2, 3, 4.",)
    assert against_random.notes == ()
    assert leaderboard.compare([one for one in runs if one.spec.seed == 5], [entry])[0].notes == ()
    # Flat curves may well be those of two runs.
    assert leaderboard.compare(grid_7x7, [random], agent="random")[0].notes == ()


def test_a_comparison_says_where_an_agent_has_other_hyperparameters_than_its_entry(
    home: Path, make_record: MakeRecord
) -> None:
    tuned = [make_record("ppo", FOUR, 5, suite="grid-7x7", hyperparameters={"learning_rate": 0.1, "k": 2})]
    against_ppo, against_random = leaderboard.compare(tuned, leaderboard.find_entries(home / "grid-7x7"))
    told = {
        f"ppo has other hyperparameters than its entry on {FOUR}: learning_rate.",
        f"ppo and its entry on {FOUR} do not both have k.",
    }
    assert told <= set(against_ppo.notes)
    assert not told & set(against_random.notes)


def test_a_task_without_a_finished_run_is_missing_and_not_passed_over(
    home: Path, grid_7x7: list[RunRecord], make_record: MakeRecord
) -> None:
    entries = leaderboard.find_entries(home / "grid-7x7")
    one_task = [record for record in grid_7x7 if record.spec.task.name == FOUR and record.spec.agent == "ppo"]
    unfinished = [make_record("ppo", KEY, seed, suite="grid-7x7", status="incomplete") for seed in range(5)]
    with pytest.raises(MissingRunsError, match="5 runs are missing"):
        leaderboard.compare([*one_task, *unfinished], entries)
    with pytest.raises(MissingRunsError, match="5 runs are missing"):
        leaderboard.compare(one_task, entries, planned=[record.spec for record in unfinished])
    assert leaderboard.compare([*one_task, *unfinished], entries, tasks=[FOUR])
    elsewhere = [make_record("ppo", KEY, seed, suite="grid").spec for seed in range(5)]
    assert len(leaderboard.compare(one_task, entries[:1], planned=elsewhere)[0].tasks) == 1


def test_a_comparison_refuses_what_is_not_comparable(home: Path, make_record: MakeRecord) -> None:
    entries = leaderboard.find_entries(home / "grid-7x7")

    def mine(**changes: Any) -> list[RunRecord]:
        return [make_record("mine", FOUR, seed, suite="grid-7x7", **changes) for seed in range(2)]

    with pytest.raises(IncomparableError, match=r"fingerprint differs: .* \(ppo of the board\), other \(mine of"):
        leaderboard.compare(mine(fingerprint="other"), entries)
    with pytest.raises(IncomparableError, match="budget differs"):
        leaderboard.compare(mine(task_changes={"budget": 9}), entries)
    with pytest.raises(IncomparableError, match="version differs"):
        leaderboard.compare(mine(suite_version=2), entries)
    other = mine(versions={"python": "3.11.7", "numpy": "1.0", "sprl-bench": "0.1.0"})
    [note] = leaderboard.compare(other, entries[:1])[0].notes[1:]
    assert note == "Different versions of numpy: 1.0 (mine of the runs), 2.4.6 (ppo of the board)."


def test_an_entry_that_is_not_comparable_is_left_out_and_named(home: Path, make_record: MakeRecord) -> None:
    entries = leaderboard.find_entries(home / "grid-7x7")
    other = [
        make_record("new", task, seed, suite="grid-7x7", fingerprint="0" * 16)
        for task in (FOUR, KEY)
        for seed in range(5)
    ]
    entries.append(leaderboard.make_entry(other, agent="new", authors=["Ada L."], link="https://example.org/paper_1"))
    mine = [make_record("mine", task, seed, suite="grid-7x7") for task in (FOUR, KEY) for seed in range(5)]
    compared = leaderboard.compare(mine, entries)
    assert [one.entry for one in compared] == ["ppo", "random"]
    text = leaderboard.render_comparisons(compared, "md")
    assert text.count("new's entry is left out as incomparable: suite 'grid-7x7', task FourRooms-7x7: environment") == 1
    assert text.rstrip().endswith("- Drops: none; the table has all 10 planned runs.")


def test_a_comparison_refuses_missing_runs(home: Path, grid_7x7: list[RunRecord], make_record: MakeRecord) -> None:
    entries = leaderboard.find_entries(home / "grid-7x7")
    with pytest.raises(MissingRunsError, match=f"{KEY}/ppo/seed-4"):
        leaderboard.compare(grid_7x7[:9], entries)
    with pytest.raises(MissingRunsError, match="seed-5"):
        leaderboard.compare(grid_7x7, entries, planned=[make_record("ppo", FOUR, 5, suite="grid-7x7").spec])
    with pytest.raises(ValueError, match="no finished run of suite 'grid-7x7'"):
        leaderboard.compare([make_record()], entries)
    with pytest.raises(ValueError, match="did you mean 'ppo'"):
        leaderboard.compare(grid_7x7, entries, agent="pppo")
    with pytest.raises(ValueError, match="did you mean 'KeyDoors-7x7'"):
        leaderboard.compare(grid_7x7, entries, tasks=["KeyDoors7x7"])
    with pytest.raises(ValueError, match="no entry to compare with"):
        leaderboard.compare(grid_7x7, [])


@pytest.mark.parametrize("form", leaderboard.COMPARISON_FORMATS)
def test_comparisons_are_rendered(form: str, home: Path, grid_7x7: list[RunRecord]) -> None:
    compared = leaderboard.compare(grid_7x7, leaderboard.find_entries(home / "grid-7x7"), agent="ppo")
    text = leaderboard.render_comparisons(compared, form)
    if form == "json":
        assert [round(one["overall"]["difference"], 3) for one in json.loads(text)] == [0.0, 0.4]
    else:
        for part in ("ppo (5 seeds, mean AUC 0.570) minus each entry", "FourRooms-", "KeyDoors-", "+0.400", "+0.000"):
            assert part in text
    with pytest.raises(ValueError, match="Unknown format 'csv'"):
        leaderboard.render_comparisons(compared, "csv")


def test_comparisons_and_boards_go_by_auc(rising: list[RunRecord], make_record: MakeRecord) -> None:
    """And not by what an agent comes to in the end."""
    late = [make_record("late", seed=seed, curve=[0.0] * 80 + [0.9 + 0.01 * seed] * 20) for seed in range(5)]
    early = [make_record("early", seed=seed, curve=[0.4 + 0.01 * seed] * 99 + [0.5]) for seed in range(5)]
    entries = [
        leaderboard.make_entry(late + early, agent=agent, authors=["Ada L."], link="https://example.org/paper_1")
        for agent in ("late", "early")
    ]
    assert [row.agent for row in leaderboard.board(entries).rows] == ["early", "late"]
    [one] = leaderboard.compare(rising, entries[:1])
    ours, theirs = (sum(run.scores.auc for run in runs) / 5 for runs in (rising, late))
    assert one.overall.difference == pytest.approx(ours - theirs)
    ours, theirs = (sum(sorted(run.scores.auc for run in runs)[1:4]) / 3 for runs in (rising, late))
    assert one.overall_iqm.difference == pytest.approx(ours - theirs)
    assert one.overall_iqm.interval != one.overall.interval
