"""How many sub-environments a published run may have, and where one that has more is told."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest

import sprl_bench
from sprl_bench import leaderboard
from sprl_bench.envs.fetch.rules import Rules
from sprl_bench.envs.grid.encoding import HORIZON
from sprl_bench.envs.maze.levels import LEVELS
from sprl_bench.executors import WorkerDiedError
from sprl_bench.records import RunRecord, RunSpec
from sprl_bench.suite import expand, run_suite
from sprl_bench.tables import tabulate
from sprl_bench.tasks import SUITES, Task, find_suite, too_wide, with_budget

FOUR, KEY = "FourRooms-7x7", "KeyDoors-7x7"
TOO_MANY = f"51 sub-environments on {FOUR} are more than the 50 that a leaderboard takes"
BENCHMARKS = [suite for suite in SUITES.values() if not suite.name.endswith("smoke")]


def horizon(task: Task) -> int:
    if task.domain == "grid":
        return HORIZON
    if task.domain == "atari":
        return 10_000  # Table 3
    if task.domain == "dmlab":
        return LEVELS[task.name.removeprefix("Maze")].horizon
    rules: Any = Rules(**task.arguments)
    return int(rules.horizon)


def widened(records: Sequence[RunRecord], num_envs: int, task: str = FOUR) -> list[RunRecord]:
    return [
        record.model_copy(update={"spec": record.spec.model_copy(update={"num_envs": num_envs})})
        if record.spec.task.name == task
        else record
        for record in records
    ]


def warnings(caplog: pytest.LogCaptureFixture) -> list[str]:
    return [record.getMessage() for record in caplog.records if record.levelname == "WARNING"]


@pytest.mark.parametrize("task", [task for suite in BENCHMARKS for task in suite.tasks], ids=lambda task: task.name)
def test_first_episodes_end_within_the_first_bin(task: Task) -> None:
    assert task.max_num_envs is not None
    assert task.max_num_envs * horizon(task) <= task.budget / 100 < (task.max_num_envs + 1) * horizon(task)


@pytest.mark.parametrize("suite", BENCHMARKS, ids=lambda suite: suite.name)
def test_no_agent_of_ours_has_too_many(suite: Any) -> None:
    specs = expand(suite, ["random", "ppo", "icm", "eco", "sprl"], [0])
    assert [fault for spec in specs if (fault := too_wide(spec.suite, spec.task.name, spec.num_envs))] == []


def test_what_is_not_published_may_have_any_number() -> None:
    assert too_wide("smoke", FOUR, 1024) == ""
    assert too_wide("custom", f"{FOUR}-300", 1024) == ""
    assert with_budget(find_suite("grid").task(FOUR), 300).max_num_envs is None
    assert too_wide("grid-7x7", FOUR, 50) == ""
    assert too_wide("grid-7x7", FOUR, 51).startswith(TOO_MANY)


def test_an_entry_has_as_many_as_are_allowed(grid_7x7: list[RunRecord], tmp_path: Path) -> None:
    def made(records: Sequence[RunRecord]) -> leaderboard.Entry:
        return leaderboard.make_entry(records, agent="ppo", authors=["Ada L."], link="https://example.org/paper")

    path = leaderboard.add_entry(made(widened(widened(grid_7x7, 50), 200, KEY)), tmp_path)
    with pytest.raises(ValueError, match=rf"tasks\.0\.num_envs: {TOO_MANY}"):
        made(widened(grid_7x7, 51))
    text = json.loads(path.read_text())
    text["tasks"][1]["num_envs"] = 201
    path.write_text(json.dumps(text, indent=1))
    [complaint] = leaderboard.validate([path])
    line = next(number for number, line in enumerate(path.read_text().splitlines(), 1) if '"num_envs": 201' in line)
    assert complaint.startswith(f"{path}:{line}: tasks.1.num_envs: 201 sub-environments on {KEY} are more than the 200")


def test_tables_tell_it(grid_7x7: list[RunRecord]) -> None:
    [table] = tabulate(widened([record for record in grid_7x7 if record.spec.agent == "ppo"], 51))
    assert [note.startswith(TOO_MANY) for note in table.notes] == [True]


class Nobody:
    """Leaves all runs undone."""

    def map(self, function: Callable[[RunSpec], Any], specs: Sequence[RunSpec]) -> Iterator[tuple[RunSpec, Any]]:
        yield from ((spec, WorkerDiedError("left undone")) for spec in specs)


@pytest.mark.parametrize(("num_envs", "told"), [(50, 0), (51, 1)])
def test_a_run_tells_it_before_its_first_step(
    num_envs: int, told: int, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    specs = expand(find_suite("grid-7x7"), ["random"], [0, 1], overrides={"num_envs": num_envs})
    run_suite(specs, tmp_path, executor=Nobody())
    assert [text.startswith(TOO_MANY) for text in warnings(caplog)] == [True] * told


@pytest.mark.parametrize(("num_envs", "told"), [(50, 0), (51, 1), (53, 1)])
@pytest.mark.parametrize("vector", [True, False])
def test_a_script_is_told_at_its_first_step(
    vector: bool, num_envs: int, told: int, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    name = f"SPRL/{FOUR}-v1"
    with sprl_bench.recording(out=tmp_path, agent="mine", seed=0):
        if vector:
            envs = gymnasium.make_vec(name, num_envs=num_envs)
            envs.reset(seed=0)
            envs.step(np.zeros(num_envs, np.int64))
            envs.close()
        else:
            single = [gymnasium.make(name) for _ in range(num_envs + 2)]
            for env in single[:2]:  # only looked at
                env.close()
            for env in single[2:]:
                env.reset(seed=0)
            for env in single[2:]:
                env.step(0)
            for env in single:
                env.close()
    assert [f"{num_envs} sub-environments" in text for text in warnings(caplog) if "leaderboard" in text] == [
        True
    ] * told
