"""What a run or an entry of a reference agent says of its privilege is what that agent declares."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from cli_calls import Capture, call
from entries import make_entry
from sprl_bench import leaderboard
from sprl_bench.agents import agent_names, load_factory
from sprl_bench.leaderboard.reference_agents import PRIVILEGED
from sprl_bench.records import RunRecord, write
from sprl_bench.records.folder import RECORD
from sprl_bench.tables import IncomparableError

MakeRecord = Callable[..., RunRecord]
TASKS = ("FourRooms-7x7", "KeyDoors-7x7")


def test_the_table_is_what_the_agents_declare() -> None:
    installed = [name for name in agent_names() if load_factory(name).__module__.startswith("sprl_baselines")]
    declared = {name: getattr(load_factory(name), "privileged", False) for name in installed}
    assert dict(PRIVILEGED) == declared


def runs_of(make_record: MakeRecord, agent: str, source: str, privileged: bool) -> list[RunRecord]:
    """Return the runs of an entry that say this of their agent."""
    made = [make_record(agent, task, seed, suite="grid-7x7", level=0.1 * seed) for task in TASKS for seed in range(5)]
    said = {"source": source, "privileged": privileged}
    return [one.model_copy(update={"spec": one.spec.model_copy(update=said)}) for one in made]


@pytest.mark.parametrize(
    ("agent", "source", "privileged", "what"),
    [
        ("gt-grid", "gt-grid", False, "it is false here; the reference agent 'gt-grid' declares true"),
        ("sprl", "sprl", True, "it is true here; the reference agent 'sprl' declares false"),
        ("mine", "gt-sprl", False, "it is false here; the reference agent 'gt-sprl' declares true"),
        ("gt-grid", "sprl_baselines.agents:gt_grid", False, "the reference agent 'gt-grid' declares true"),
    ],
)
def test_another_privilege_than_the_agents_is_refused(
    agent: str, source: str, privileged: bool, what: str, make_record: MakeRecord, capsys: Capture, tmp_path: Path
) -> None:
    runs = runs_of(make_record, agent, source, privileged)
    for run in runs:
        write(run.spec.path(tmp_path / "runs") / RECORD, run)
    words = ["leaderboard", "add", tmp_path / "runs", "--agent", agent, "--home", tmp_path / "boards"]
    for more in (["--author", "Ada", "--link", "https://example.org/a"], ["--pending"]):
        status, _, err = call(capsys, *words, *more)
        assert status != 0
        assert what in err
        assert err.count("\n") == 1
    with pytest.raises(IncomparableError, match="privileged: it is"):
        leaderboard.add_pending(runs, tmp_path / "boards", agent=agent)
    assert not list((tmp_path / "boards").rglob("*.json"))


def test_a_forged_privilege_is_found_in_a_file(make_record: MakeRecord, capsys: Capture, tmp_path: Path) -> None:
    entry = make_entry(runs_of(make_record, "gt-grid", "gt-grid", privileged=True), "gt-grid")
    path = leaderboard.add_entry(entry, tmp_path)
    assert leaderboard.validate([path]) == []
    text = path.read_text()
    path.write_text(text.replace('"privileged": true', '"privileged": false'))
    status, _, err = call(capsys, "leaderboard", "validate", path)
    line = text[: text.index('"privileged"')].count("\n") + 1
    assert status == 1
    assert err == f"{path}:{line}: privileged: it is false here; the reference agent 'gt-grid' declares true\n"


@pytest.mark.parametrize("source", ["", "mine:gt_grid"])
def test_an_agent_of_someone_else_may_have_the_name(source: str, make_record: MakeRecord) -> None:
    assert not make_entry(runs_of(make_record, "gt-grid", source, privileged=False), "gt-grid").privileged
