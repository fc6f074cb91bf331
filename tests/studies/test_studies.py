"""Studies: what they run, how made-up records are judged, and the way from the command to the page."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cli_calls import Capture, call
from sprl_bench import executors, leaderboard, studies
from sprl_bench.records import RunRecord, RunSpec, write
from sprl_bench.records.folder import METRICS, RECORD
from sprl_bench.studies import STUDIES, Evidence, Study
from sprl_bench.tables import Result

MakeRecord = Callable[..., RunRecord]
Levels = Callable[[str, str], float]


def made_up(study: Study, levels: Levels, make_record: MakeRecord, root: Path, spread: float = 0.01) -> Evidence:
    """Write records of all runs of a study with three seeds, each agent and task at its level, and read them."""
    specs = studies.specs_of(study, [0, 1, 2])
    for spec in specs:
        level = levels(spec.agent, spec.task.name) + spread * (spec.seed - 1)
        record = make_record("any", level=min(1.0, max(0.0, level)))
        scores = record.scores.model_copy(
            update={"steps_to_threshold": None if level < 0.5 else spec.task.budget // 100}
        )
        totals = record.totals.model_copy(update={"env_steps": spec.task.budget})
        changes: dict[str, Any] = {"spec": spec, "scores": scores, "totals": totals, "fingerprint": spec.task.name}
        write(spec.path(root) / RECORD, record.model_copy(update=changes))
        if study.metric:
            lines = [f'{{"env_steps": {step}, "{study.metric}": {level}}}\n' for step in (1000, 300_000, 10**7)]
            (spec.path(root) / METRICS).write_text("".join(lines))
    return studies.evidence_of(specs, root)


def by_agent(levels: Mapping[str, float], otherwise: float) -> Levels:
    return lambda agent, _task: next((level for part, level in levels.items() if part in agent), otherwise)


def gap(hard: str, sparse: float, dense: float) -> Levels:
    """SPRL's lead over the others on the tasks with this ending, and on all others."""
    return lambda agent, task: 0.3 + (agent == "sprl") * (sparse if task.endswith(hard) else dense)


CASES: list[tuple[str, Levels, Levels]] = [
    ("fig10", by_agent({"k=": 0.3}, 0.7), by_agent({"k=7": 0.8}, 0.3)),
    ("fig12", by_agent({"tolerance=": 0.3}, 0.7), by_agent({"tolerance=10": 0.8}, 0.3)),
    ("fig14", by_agent({"stack=": 0.3}, 0.7), by_agent({"stack=1": 0.8}, 0.3)),
    ("fig15", gap("substep2", 0.5, 0.1), gap("substep2", 0.1, 0.5)),
    ("fig16", gap("noise0.3", 0.5, 0.1), gap("noise0.3", 0.1, 0.5)),
    ("fig17", lambda _a, _t: 0.9, lambda _a, t: 0.6 if t == "KeyDoors-11x11" else 0.9),
    ("fig20", lambda _a, _t: 0.98, lambda _a, t: 0.8 if "Push" in t else 0.98),
    ("fig21", by_agent({"gt-": 0.3}, 0.7), by_agent({"gt-": 0.8}, 0.3)),
]


def test_every_study_has_its_cases() -> None:
    assert [name for name, *_ in CASES] == [name for name, study in STUDIES.items() if study.draw is None]


@pytest.mark.parametrize(("name", "supporting", "contradicting"), CASES)
def test_the_three_verdicts(
    name: str, supporting: Levels, contradicting: Levels, make_record: MakeRecord, tmp_path: Path
) -> None:
    study = STUDIES[name]
    evidence = made_up(study, supporting, make_record, tmp_path / "a")
    assert study.judge(evidence, study.agents).outcome == "supported"
    evidence = made_up(study, contradicting, make_record, tmp_path / "b")
    assert study.judge(evidence, study.agents).outcome == "contradicted"
    middle = study.metric and {"fig17": 0.8, "fig20": 0.95}[name]
    evidence = made_up(study, lambda _a, _t: middle or 0.5, make_record, tmp_path / "c", spread=0.04)
    assert study.judge(evidence, study.agents).outcome == "not decided"
    assert study.judge(Evidence(), study.agents).why


@pytest.mark.parametrize("name", [name for name, *_ in CASES])
def test_a_page_with_a_figure(name: str, make_record: MakeRecord, tmp_path: Path) -> None:
    study = STUDIES[name]
    evidence = made_up(study, CASES[[one for one, *_ in CASES].index(name)][1], make_record, tmp_path)
    verdict = study.judge(evidence, study.agents)
    written = studies.write_study(study, evidence, verdict, tmp_path / "page", command="the command")
    assert [path.suffix for path in written] == list(studies.STEMS)
    page = written[0].read_text()
    rows = [f"| {one.what} | {one.value:+.3f} | {one.ends} |" for one in verdict.differences]
    for part in (study.claim, verdict.short, *rows, f"]({name}.png)", "seeds 0, 1, 2", "the command", "| Agent |"):
        assert part in page


@pytest.mark.parametrize("study", STUDIES.values(), ids=lambda study: study.name)
def test_its_runs_are_of_published_tasks(study: Study) -> None:
    specs = studies.specs_of(study, [0])
    assert len({(spec.task.name, spec.agent) for spec in specs}) == len(specs)
    assert bool(specs) is (study.name != "sec6.6")
    assert {spec.suite for spec in specs} == set(study.tasks)
    shares = studies.specs_of(study, [0], 0.01)
    assert {spec.suite for spec in shares} <= {"custom"}


def test_another_base_keeps_what_varies() -> None:
    """What varies has its own values on any base, also where one of them is the base's own and need not be named."""
    for base, unnamed in (("sprl", 2), ("sprl@tuned+bias=0.1", 2), ("sprl@ablation", 5)):
        expected = [base if k == unnamed else f"{base}+k={k}" for k in (2, 3, 5, 7)]
        assert list(STUDIES["fig10"].on_base(base)) == expected
        specs = studies.specs_of(STUDIES["fig10"], [0], agents=expected, tasks=["FourRooms-7x7"])
        assert [spec.hyperparameters["k"] for spec in specs] == [2, 3, 5, 7]
    with pytest.raises(ValueError, match="base is 'sprl'; it must be left out, as fig15 compares different agents"):
        STUDIES["fig15"].on_base("sprl")
    with pytest.raises(ValueError, match=r"base is 'sprl\+k=3'; it must leave out k, which fig10 varies"):
        STUDIES["fig10"].on_base("sprl+k=3")


def test_other_runs_in_the_folder_are_not_evidence(make_record: MakeRecord, tmp_path: Path) -> None:
    study = STUDIES["fig21"]
    made_up(study, by_agent({}, 0.5), make_record, tmp_path)
    evidence = studies.evidence_of(studies.specs_of(study, [0, 7], tasks=["KeyDoors-7x7"]), tmp_path)
    assert {(one.task.name, one.seed) for one in evidence.results} == {("KeyDoors-7x7", 0)}
    assert studies.missing_runs(studies.specs_of(study, [0, 7], tasks=["KeyDoors-7x7"]), evidence) == [
        f"{agent} on KeyDoors-7x7, seed 7" for agent in study.agents
    ]
    assert isinstance(evidence.results[0], Result)


# --------------------------------------------------------------------------------------- on the command line

TINY = ["--seeds", "1", "--workers", "2", "--device", "cpu"]


class Here:
    """Runs in this process, one after the other: a process each would take most of the time."""

    def map(self, function: Callable[[RunSpec], Any], specs: Sequence[RunSpec]) -> Iterator[tuple[RunSpec, Any]]:
        for spec in specs:
            yield spec, function(spec)


def test_all_studies_are_listed(capsys: Capture) -> None:
    status, printed, _ = call(capsys, "reproduce", "list")
    assert (status, [line.split()[0] for line in printed.splitlines()]) == (0, list(STUDIES))


@pytest.mark.parametrize(
    ("name", "share", "tasks"),
    [
        ("fig10", "0.004", ["FourRooms-7x7"]),
        ("fig12", "0.004", ["FourRooms-7x7"]),
        ("fig14", "0.004", ["FourRooms-7x7"]),
        ("fig15", "0.0032", ["FetchReach-substep2", "FetchReach-substep6"]),
        ("fig16", "0.0032", ["FetchReach-substep2", "FetchReach-substep2-noise0.3"]),
        ("fig17", "0.004", ["FourRooms-7x7"]),
        ("fig20", "0.0032", ["FetchReach-substep2"]),
        ("fig21", "0.004", ["FourRooms-7x7"]),
    ],
)
def test_it_runs_to_the_end_and_again_from_what_is_there(
    name: str, share: str, tasks: list[str], capsys: Capture, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A fraction of the budget, one seed: nothing can be decided, but everything is made."""
    monkeypatch.setattr(executors, "make_executor", lambda *_: Here())
    command = ["reproduce", name, *TINY, "--budget-share", share, "--out", tmp_path]
    command += [word for task in tasks for word in ("--task", task)]
    status, printed, err = call(capsys, *command)
    assert status == 0, err
    assert "Verdict: Not decided" in printed
    is_short = "are not in use before env step" in printed
    assert is_short is ("**Too short.**" in (tmp_path / f"{name}.md").read_text())
    assert is_short
    page = (tmp_path / f"{name}.md").read_text()
    assert f"sprl-bench reproduce {name} --seeds 1 --budget-share {share}" in page
    before = {path: path.stat().st_mtime_ns for path in tmp_path.rglob(RECORD)}
    status, printed, _ = call(capsys, *command, "--runs", tmp_path)
    assert (status, "Verdict: Not decided" in printed) == (0, True)
    assert (tmp_path / f"{name}.md").read_text() == page
    assert {path: path.stat().st_mtime_ns for path in tmp_path.rglob(RECORD)} == before


def test_a_kill_in_the_middle_costs_nothing_that_was_finished(tmp_path: Path) -> None:
    """The whole process group is killed once a run is finished; the same command ends with every run."""
    words = ["reproduce", "fig21", "--seeds", "2", "--workers", "1", "--device", "cpu", "--budget-share", "0.004"]
    code = "import sys; from sprl_bench.cli import main; sys.exit(main())"
    command = [sys.executable, "-c", code, *words, "--task", "FourRooms-7x7", "--out", str(tmp_path)]
    killed = subprocess.Popen(command, start_new_session=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    deadline = time.monotonic() + 120
    while not (finished := list(tmp_path.rglob(RECORD))) and time.monotonic() < deadline:
        time.sleep(0.05)
    os.killpg(killed.pid, signal.SIGKILL)
    killed.wait()
    before = {path: path.read_bytes() for path in finished}
    assert before
    assert not (tmp_path / "fig21.md").exists()
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, check=True)
    assert "Verdict: Not decided" in done.stdout
    assert len(list(tmp_path.rglob(RECORD))) == 4
    assert {path: path.read_bytes() for path in before} == before


def test_what_is_there_is_judged_and_the_rest_is_named(
    capsys: Capture, make_record: MakeRecord, tmp_path: Path
) -> None:
    made_up(STUDIES["fig21"], by_agent({"gt-": 0.3}, 0.7), make_record, tmp_path / "runs")
    command = ["reproduce", "fig21", "--seeds", "4", "--runs", tmp_path / "runs", "--out", tmp_path / "out"]
    status, printed, err = call(capsys, *command)
    assert status == 0
    assert "Verdict: Supported." in printed
    assert "learned minus exact on FourRooms-7x7: +0.400" in printed
    assert "8 of 32 runs are missing: sprl@tuned on FourRooms-7x7, seed 3" in err
    assert "**Missing.** 8 runs" in (tmp_path / "out" / "fig21.md").read_text()
    status, printed, err = call(capsys, "reproduce", "fig21", "--runs", tmp_path / "nowhere", "--out", tmp_path)
    assert (status, "nowhere does not exist" in err) == (1, True)


def test_a_board_is_judged_by_its_entries(capsys: Capture, tmp_path: Path) -> None:
    """The figures are those of the board; what it lacks is named, and nothing is trained."""
    status, printed, err = call(capsys, "reproduce", "fig21", "--board", "grid-7x7", "--out", tmp_path)
    assert (status, "20 of 40 runs are missing" in err) == (0, True)
    entries = {entry.agent: entry.results() for entry in leaderboard.find_board("grid-7x7")}
    for task in ("FourRooms-7x7", "KeyDoors-7x7"):
        learned, exact = (
            np.mean([one.scores.auc for one in entries[agent] if one.task.name == task])
            for agent in ("sprl@tuned", "gt-sprl@tuned")
        )
        assert f"learned minus exact on {task}: {learned - exact:+.3f}" in printed
    assert not list(tmp_path.rglob(RECORD))
    for words, message in (
        (
            ["fig10", "--board", "grid-7x7"],
            "it must be one with entries that the study asks for, such as sprl@ablation",
        ),
        (["fig21", "--board", "grid-7x7", "--runs", tmp_path], "board is 'grid-7x7'; it must be left out where --runs"),
        (["fig21", "--board", "grid-9x9"], "Unknown entry or board 'grid-9x9'"),
    ):
        status, _, err = call(capsys, "reproduce", *words, "--out", tmp_path / "out")
        assert (status != 0, message in err) == (True, True), err


def test_runs_of_something_else_are_not_judged(capsys: Capture, make_record: MakeRecord, tmp_path: Path) -> None:
    """Other seeds, budgets or agents: the command says what the folder holds instead."""
    made_up(STUDIES["fig21"], by_agent({}, 0.5), make_record, tmp_path / "runs")
    command = ["reproduce", "fig21", "--runs", tmp_path / "runs", "--out", tmp_path / "out"]
    for words in (["--seeds", "7,"], ["--budget-share", "0.5"]):
        status, printed, err = call(capsys, *command, *words)
        assert (status, printed) == (1, "")
        assert "holds no finished run of fig21 with these seeds and budgets, such as sprl@tuned on FourRooms-7x7" in err
        assert "it holds gt-sprl@tuned on FourRooms-11x11, seed 0; " in err
        assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["fig9"], "Unknown study 'fig9'; did you mean"),
        (["fig10", "--task", "KeyDoors"], "Unknown task of fig10: 'KeyDoors'; did you mean 'KeyDoors-7x7'"),
        (["fig10", "--budget-share", "2"], "budget_share is 2.0; it must be above 0 and at most 1"),
        (["fig15", "--base", "sprl"], "base is 'sprl'; it must be left out"),
        (["fig10", "--base", "sprll"], "Unknown agent 'sprll'; did you mean 'sprl'"),
        (["fig10", "--seeds", "none"], "seeds is 'none'"),
    ],
)
def test_what_is_refused(words: list[str], message: str, capsys: Capture, tmp_path: Path) -> None:
    status, _, err = call(capsys, "reproduce", *words, "--out", tmp_path / "out")
    assert status != 0
    assert message in err
    assert not (tmp_path / "out").exists()
