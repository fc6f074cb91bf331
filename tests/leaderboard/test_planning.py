"""Plans: how many more seeds would decide against an entry, and what the rule for looking one by one says."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from sprl_bench import leaderboard
from sprl_bench.cli import main
from sprl_bench.leaderboard import Plan, plan_seeds, render_plans
from sprl_bench.records import RunRecord

MakeRecord = Callable[..., RunRecord]
TASKS = {"FourRooms-7x7": 0.0, "KeyDoors-7x7": 0.1}
STEPS = (0.0, 0.03, -0.02, 0.02, -0.03, 0.01, -0.01)


def runs(make_record: MakeRecord, level: float, seeds: int, agent: str = "mine") -> list[RunRecord]:
    return [
        make_record(agent, task, seed, suite="grid-7x7", level=level + more + STEPS[seed % 7])
        for task, more in TASKS.items()
        for seed in range(seeds)
    ]


def plan_of(make_record: MakeRecord, home: Path, level: float, seeds: int = 5) -> Plan:
    [one, _] = plan_seeds(runs(make_record, level, seeds), leaderboard.find_entries(home / "grid-7x7"))
    return one  # against ppo: 0.52 and 0.62


def test_a_clear_difference_is_decided_and_asks_for_nothing(make_record: MakeRecord, home: Path) -> None:
    one = plan_of(make_record, home, 0.8)
    assert (one.more_seeds, one.more_seeds_of_both, one.decided_better) == (0, 0, True)
    assert one.power is not None
    assert one.power > 0.95
    assert one.decided_at is not None
    assert one.decided_at <= 5
    assert plan_of(make_record, home, 0.2).decided_better is False
    assert "better, decided at seed" in render_plans([one])


def test_a_smaller_difference_asks_for_more_seeds(make_record: MakeRecord, home: Path) -> None:
    small, smaller = plan_of(make_record, home, 0.537), plan_of(make_record, home, 0.531)
    assert small.decided_at is smaller.decided_at is None
    assert small.more_seeds_of_both is not None
    assert smaller.more_seeds_of_both is not None
    assert 0 < small.more_seeds_of_both < smaller.more_seeds_of_both
    assert small.power is not None
    assert smaller.power is not None
    assert small.power > smaller.power


def test_no_difference_is_never_decided(make_record: MakeRecord, home: Path) -> None:
    one = plan_of(make_record, home, 0.52)
    assert (one.more_seeds, one.more_seeds_of_both, one.decided_at, one.more_looks) == (None, None, None, None)
    assert "open after 5 of 30; most likely not" in render_plans([one])


def test_a_single_seed_has_no_power(make_record: MakeRecord, home: Path) -> None:
    one = plan_of(make_record, home, 0.8, seeds=1)
    assert (one.power, one.more_seeds, one.decided_at) == (None, None, None)
    assert "| mine | ppo | 1 and 5 |" in render_plans([one])


def test_the_command_says_so(
    make_record: MakeRecord,
    home: Path,
    write_runs: Callable[[list[RunRecord]], Path],
    capsys: pytest.CaptureFixture[str],
) -> None:
    words = ["power", str(write_runs(runs(make_record, 0.8, 5))), "--against", str(home / "grid-7x7" / "ppo.json")]
    assert main([*words, "--looks", "10", "--format", "json"]) == 0
    [found] = json.loads(capsys.readouterr().out)
    assert (found["comparison"]["entry"], found["looks"], found["more_seeds"]) == ("ppo", 10, 0)
    assert main([*words, "--format", "md"]) == 0
    assert "### Seeds that would decide, suite grid-7x7, version 1" in capsys.readouterr().out
    assert main([*words, "--looks", "0"]) != 0
