"""Entries: what one must hold, what is refused and where, and what a board leaves out."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from entries import make_entry
from sprl_bench import leaderboard
from sprl_bench.leaderboard import Entry
from sprl_bench.records import Hardware, InvalidFileError, RunRecord, Scores, TaskSpec, write
from sprl_bench.tables import SCORED_PACKAGES, IncomparableError, MissingRunsError

MakeRecord = Callable[..., RunRecord]
Make = Callable[..., Entry]
FOUR, KEY = "FourRooms-7x7", "KeyDoors-7x7"
VERSIONS = {"python": "3.11.7", "numpy": "2.4.6", "sprl-bench": "0.1.0"}


def test_an_entry_holds_every_seed(grid_7x7: list[RunRecord]) -> None:
    entry = make_entry(grid_7x7, status="reproduced")
    assert (entry.agent, entry.authors, entry.status, entry.privileged) == ("ppo", ("Ada L.",), "reproduced", False)
    assert (entry.suite, entry.suite_version) == ("grid-7x7", 1)
    assert [part.task.name for part in entry.tasks] == [FOUR, KEY]
    assert [part.seeds for part in entry.tasks] == [(0, 1, 2, 3, 4)] * 2
    record = next(record for record in grid_7x7 if record.spec.task.name == KEY and record.spec.seed == 3)
    result = entry.tasks[1].results[3]
    assert (result.scores, result.return_curve) == (record.scores, record.return_curve)
    assert (result.success_curve, result.device) == (record.success_curve, "cpu")
    assert entry.tasks[1].hyperparameters == record.spec.hyperparameters
    assert entry.tasks[1].fingerprint == record.fingerprint
    assert entry.git_commits == ()
    assert entry.versions == record.versions
    assert entry.hardware == (record.hardware,)


def test_an_entry_comes_back_and_is_valid(home: Path, grid_7x7: list[RunRecord]) -> None:
    path = home / "grid-7x7" / "ppo.json"
    assert leaderboard.read_entry(path) == make_entry(grid_7x7)
    assert leaderboard.validate(sorted(home.glob("*/*.json"))) == []
    assert [entry.agent for entry in leaderboard.find_entries(home / "grid-7x7")] == ["ppo", "random"]


def test_an_entry_is_never_overwritten_unasked(home: Path, grid_7x7: list[RunRecord]) -> None:
    path = home / "grid-7x7" / "ppo.json"
    before = path.read_bytes()
    changed = make_entry(grid_7x7, authors=["Eve"])
    with pytest.raises(FileExistsError, match="--replace"):
        leaderboard.add_entry(changed, home)
    assert path.read_bytes() == before
    assert leaderboard.add_entry(changed, home, replace=True) == path
    assert leaderboard.read_entry(path).authors == ("Eve",)


def test_ragged_runs_are_never_published(grid_7x7: list[RunRecord]) -> None:
    ragged = [record for record in grid_7x7 if (record.spec.task.name, record.spec.seed) != (KEY, 4)]
    with pytest.raises(MissingRunsError, match=f"same seeds on all tasks.*1 run is missing: {KEY}/ppo/seed-4"):
        make_entry(ragged)


def test_half_a_suite_is_never_published(grid_7x7: list[RunRecord]) -> None:
    with pytest.raises(MissingRunsError, match="5 runs are missing"):
        make_entry([record for record in grid_7x7 if record.spec.task.name == FOUR])


def test_incomplete_and_planned_runs_are_missing(grid_7x7: list[RunRecord], make_record: MakeRecord) -> None:
    more = make_record("ppo", FOUR, 5, suite="grid-7x7")
    with pytest.raises(MissingRunsError, match="2 runs are missing"):
        make_entry(grid_7x7, planned=[more.spec])
    with pytest.raises(MissingRunsError, match="2 runs are missing"):
        make_entry([*grid_7x7, more.model_copy(update={"status": "incomplete"})])
    assert make_entry(grid_7x7, planned=[make_record("other", FOUR, 9, suite="grid-7x7").spec])


def test_fewer_than_five_seeds_are_never_published(grid_7x7: list[RunRecord]) -> None:
    with pytest.raises(MissingRunsError, match="needs at least 5 seeds; ppo has 4"):
        make_entry([record for record in grid_7x7 if record.spec.seed < 4])


def test_another_budget_is_never_published(make_record: MakeRecord) -> None:
    records = [make_record(seed=seed, task_changes={"budget": 1_000}) for seed in range(5)]
    with pytest.raises(ValueError, match=r"tasks\.0\.task\.budget: it is 1000, the suite's is 100000"):
        make_entry(records)


def test_runs_of_no_suite_are_never_published(make_record: MakeRecord) -> None:
    records = [make_record(seed=seed) for seed in range(5)]
    custom = [
        record.model_copy(update={"spec": record.spec.model_copy(update={"suite": "custom"})}) for record in records
    ]
    with pytest.raises(ValueError, match="Unknown suite 'custom'"):
        make_entry(custom)


def test_runs_of_several_makes_are_never_published(make_record: MakeRecord) -> None:
    def runs(**changes: Any) -> list[RunRecord]:
        return [make_record(seed=seed) for seed in range(4)] + [make_record(seed=4, **changes)]

    with pytest.raises(IncomparableError, match="fingerprint differs"):
        make_entry(runs(fingerprint="other"))
    with pytest.raises(IncomparableError, match="seeds differ in the hyperparameter learning_rate"):
        make_entry(runs(hyperparameters={}))
    with pytest.raises(
        IncomparableError, match=r"one version of numpy; those of FourRooms-7x7 have 1\.0 \(ppo\), 2\.4\.6 \(ppo\)"
    ):
        make_entry(runs(versions={**VERSIONS, "numpy": "1.0"}))
    for field, value, told in (
        ("torch_threads", 2, "torch_threads differs between seeds"),
        ("source", "other:ppo", "source differs between seeds"),
        ("num_envs", 3, "agent ppo: num_envs differs: 12"),
    ):
        last = make_record(seed=4)
        changed = last.model_copy(update={"spec": last.spec.model_copy(update={field: value})})
        with pytest.raises(IncomparableError, match=told):
            make_entry([*runs()[:4], changed])


def test_an_entry_keeps_the_share_of_abandoned_episodes(make_record: MakeRecord) -> None:
    runs = [make_record(seed=seed) for seed in range(5)]
    runs[2] = runs[2].model_copy(update={"totals": runs[2].totals.model_copy(update={"abandoned": 7})})
    entry = make_entry(runs)
    assert [result.abandoned_share for result in entry.tasks[0].results] == [0, 0, 0.07, 0, 0]
    assert [note for note in leaderboard.board([entry]).notes if note.startswith("ppo reset up to 7%")]


def test_an_entry_that_breaks_its_board_is_not_valid(home: Path, grid_7x7: list[RunRecord]) -> None:
    odd = make_entry([record.model_copy(update={"fingerprint": "f" * 16}) for record in grid_7x7])
    path = home / "grid-7x7" / "ppo.json"
    path.unlink()
    write(path, odd)
    others = [other for other in path.parent.glob("*.json") if other != path]
    complaints = leaderboard.validate([path, *others])
    assert len(complaints) == 1 + len(others)
    told = f"{path}:1: beside random.json: suite 'grid-7x7', task {FOUR}: environment fingerprint differs: "
    assert complaints[0].startswith(told)
    path.unlink()
    (path.parent / "dangling.json").symlink_to("nowhere")
    assert leaderboard.validate(others) == []


def test_an_agents_code_is_one(make_record: MakeRecord) -> None:
    runs = [make_record(seed=seed, agent_code="aa" if seed else "bb") for seed in range(5)]
    with pytest.raises(IncomparableError, match="one version of its agent's code; ppo's file changed between runs"):
        make_entry(runs)
    scripts = [run.model_copy(update={"spec": run.spec.model_copy(update={"source": ""})}) for run in runs]
    assert make_entry(scripts).agent_codes == ("aa", "bb")
    assert make_entry([make_record(seed=seed, agent_code="aa") for seed in range(5)]).agent_codes == ("aa",)


def test_scripts_have_as_many_threads_as_their_machines(make_record: MakeRecord) -> None:
    runs = [make_record(seed=seed) for seed in range(5)]
    scripts = [
        run.model_copy(
            update={"spec": run.spec.model_copy(update={"source": "", "torch_threads": 1 + run.spec.seed % 2})}
        )
        for run in runs
    ]
    entry = make_entry(scripts)
    assert [result.torch_threads for result in entry.tasks[0].results] == [1, 2, 1, 2, 1]
    assert "Different numbers of torch threads: 1 (ppo), 2 (ppo)." in leaderboard.board([entry]).notes


@pytest.mark.parametrize("package", SCORED_PACKAGES)
def test_what_a_score_depends_on_has_one_version(make_record: MakeRecord, package: str) -> None:
    runs = [make_record(seed=seed, versions={**VERSIONS, package: f"0.{min(seed, 1)}"}) for seed in range(5)]
    with pytest.raises(IncomparableError, match=f"version of {package}"):
        make_entry(runs)


def test_a_task_may_be_trained_on_another_machine(grid_7x7: list[RunRecord]) -> None:
    other = {**VERSIONS, "numpy": "9.9", "torch": "2.11.0"}
    mixed = [run if run.spec.task.name == FOUR else run.model_copy(update={"versions": other}) for run in grid_7x7]
    entry = make_entry(mixed)
    assert [task.versions.get("numpy") for task in entry.tasks] == ["2.4.6", "9.9"]
    assert "rich" not in entry.tasks[1].versions
    assert entry.versions["python"] == VERSIONS["python"]
    loaded = {(result.task.name, result.versions["numpy"]) for result in entry.results()}
    assert loaded == {(FOUR, "2.4.6"), (KEY, "9.9")}
    notes = leaderboard.board([entry]).notes
    assert "Different versions of numpy: 2.4.6 (ppo), 9.9 (ppo)." in notes
    of_one_task = [run for run in mixed if run.spec.task.name == KEY]
    of_one_task[0] = of_one_task[0].model_copy(update={"versions": VERSIONS})
    with pytest.raises(IncomparableError, match=r"one version of numpy; those of KeyDoors-7x7 have 2\.4\.6"):
        make_entry([run for run in mixed if run.spec.task.name == FOUR] + of_one_task)


def test_what_no_score_depends_on_may_differ_and_is_kept(make_record: MakeRecord) -> None:
    records = [make_record(seed=seed, versions={**VERSIONS, "rich": f"{seed % 2}"}) for seed in range(5)]
    other = Hardware(cpu="another", cores=8, memory_gib=16.0)
    entry = make_entry([*records[:4], records[4].model_copy(update={"hardware": other})])
    assert entry.versions == {**VERSIONS, "rich": "0, 1"}
    assert {machine.cpu for machine in entry.hardware} == {"made up", "another"}


def test_an_entry_keeps_the_commits_that_its_runs_were_made_with(make_record: MakeRecord) -> None:
    commits = [None, "b" * 40, f"{'a' * 40}, {'b' * 40}-dirty", None, None]
    entry = make_entry([make_record(seed=seed, git_commit=commit) for seed, commit in enumerate(commits)])
    assert entry.git_commits == (f"{'a' * 40}, {'b' * 40}-dirty", "b" * 40)
    assert leaderboard.board([entry]).notes[0] == (
        "Made with a changed checkout of sprl-bench: aaaaaaaaaa, bbbbbbbbbb-dirty, bbbbbbbbbb."
    )


def test_a_broken_entry_may_be_replaced_and_another_one_s_not_be_passed_over(
    home: Path, grid_7x7: list[RunRecord]
) -> None:
    (home / "grid-7x7" / "ppo.json").write_text("{}")
    with pytest.raises(InvalidFileError):
        leaderboard.add_entry(make_entry(grid_7x7, "random"), home, replace=True)
    leaderboard.add_entry(make_entry(grid_7x7, "ppo"), home, replace=True)
    assert len(leaderboard.find_entries(home / "grid-7x7")) == 2


def test_an_agent_that_always_or_never_succeeds_may_have_equal_curves(make_record: MakeRecord) -> None:
    always = [make_record(seed=seed, curve=[0.0] * 2 + [1.0] * 98) for seed in range(5)]
    assert make_entry(always)
    with pytest.raises(ValueError, match="its curves are those of seed 0"):
        make_entry([make_record(seed=seed, curve=[0.0] * 2 + [0.9] * 98) for seed in range(5)])


def test_an_agent_that_has_finished_nothing_is_no_unknown_one(make_record: MakeRecord) -> None:
    with pytest.raises(MissingRunsError, match=r"^Agent 'ppo' has no finished run\.$"):
        make_entry([make_record(status="incomplete")])


def test_an_unknown_agent_or_suite_is_refused(grid_7x7: list[RunRecord], make_record: MakeRecord) -> None:
    with pytest.raises(ValueError, match="did you mean 'random'"):
        make_entry(grid_7x7, "randon")
    with pytest.raises(ValueError, match="did you mean 'grid-7x7'"):
        make_entry(grid_7x7, suite="grid-7x")
    with pytest.raises(MissingRunsError, match="'ppo' has no finished run of suite 'grid'"):
        make_entry(grid_7x7, suite="grid")
    both = [*grid_7x7, *(make_record("ppo", seed=seed) for seed in range(5))]
    with pytest.raises(ValueError, match=r"several suites.*grid-7x7, smoke"):
        make_entry(both)
    assert make_entry(both, suite="smoke").suite == "smoke"


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"authors": []}, "authors: "),
        ({"authors": [" "]}, r"authors\.0: "),
        ({"authors": ["a\nb"]}, r"authors\.0: "),
        ({"link": "example.org"}, "link: 'example.org' is not a link"),
        ({"link": "javascript://x.y"}, "link: "),
        ({"link": "https://a.b/ c"}, "link: "),
        ({"status": "true"}, "status: "),
    ],
)
def test_what_an_entry_says_of_itself_is_checked(
    changes: dict[str, Any], message: str, grid_7x7: list[RunRecord]
) -> None:
    with pytest.raises(ValueError, match=message) as caught:
        make_entry(grid_7x7, **changes)
    assert "\n" not in str(caught.value)


Edit = Callable[[dict[str, Any]], None]


def edit(path: Path, change: Edit) -> None:
    data = json.loads(path.read_text())
    change(data)
    path.write_text(json.dumps(data, indent=1))


def _drop_seed(data: dict[str, Any]) -> None:
    del data["tasks"][1]["results"][4]


def _replace_seed(data: dict[str, Any]) -> None:
    data["tasks"][1]["results"][4]["seed"] = 7


def _repeat_seed(data: dict[str, Any]) -> None:
    data["tasks"][1]["results"][4] = data["tasks"][1]["results"][3]


def _repeat_task(data: dict[str, Any]) -> None:
    data["tasks"][1] = data["tasks"][0]


def _raise_score(data: dict[str, Any]) -> None:
    data["tasks"][1]["results"][2]["scores"]["auc"] = 0.9


def _raise_curve(data: dict[str, Any]) -> None:
    data["tasks"][1]["results"][2]["return_curve"][7] = 1.5


def _lower_success(data: dict[str, Any]) -> None:
    data["tasks"][0]["results"][1]["success_curve"][7] = -0.5


def _tune(data: dict[str, Any]) -> None:
    data["tasks"][0]["hyperparameters"]["learning_rate"] = 1.0


def _copy_run(data: dict[str, Any]) -> None:
    for number in (1, 3):
        result = data["tasks"][0]["results"][number]
        result["return_curve"] = result["success_curve"] = [0.25] * 50 + [0.75] * 50
        task = TaskSpec(**data["tasks"][0]["task"])
        result["scores"] = Scores.of(task, result["return_curve"], result["success_curve"]).model_dump()


def _forget_version(data: dict[str, Any]) -> None:
    del data["versions"]["numpy"]


def _set(*place: str | int, value: Any) -> Edit:
    def change(data: dict[str, Any]) -> None:
        inner: Any = data
        for part in place[:-1]:
            inner = inner[part]
        inner[place[-1]] = value

    return change


INVALID: dict[str, tuple[Edit, str, str]] = {
    "fewer seeds": (_drop_seed, "tasks.1: results has 4 of at least 5 seeds", '"results"'),
    "other seeds": (_replace_seed, "tasks[1].results has the seeds [0, 1, 2, 3, 7]", '"results"'),
    "repeated seeds": (_repeat_seed, "each once, in ascending order", '"results"'),
    "repeated task": (_repeat_task, "tasks[1].task.name is 'FourRooms-7x7' for a second time", '"name"'),
    "a better score": (_raise_score, "results[2].scores.auc is 0.9 but its curve gives", '"auc": 0.9'),
    "an impossible return": (_raise_curve, "results[2].return_curve[7] is 1.5, outside of [0, 1]", "1.5"),
    "an impossible success": (_lower_success, "results[1].success_curve[7] is -0.5, outside of [0, 1]", "-0.5"),
    "a share of minus zero": (
        _set("tasks", 1, "results", 2, "abandoned_share", value=-0.0),
        "tasks.1.results.2.abandoned_share: it is -0.0; it must be 0.0 or more",
        '"abandoned_share": -0.0',
    ),
    "other hyperparameters": (_tune, "hyperparameters_hash does not follow", '"hyperparameters_hash"'),
    "a key of its own": (_set("wins", value=True), "wins: this key is unknown", '"wins"'),
    "a mean": (_set("tasks", 0, "mean", value=0.9), "tasks.0.mean: this key is unknown", '"mean"'),
    "another suite": (_set("suite", value="gird"), "Unknown suite 'gird'", '"suite"'),
    "another version": (_set("suite_version", value=2), "suite_version: it is 2", '"suite_version"'),
    "no authors": (_set("authors", value=[]), "authors", '"authors"'),
    "a yes": (_set("privileged", value="no"), "privileged", '"privileged"'),
    "a budget of its own": (
        _set("tasks", 1, "task", "budget", value=9_000_000),
        "scores.steps_to_threshold",
        '"steps_to_threshold"',
    ),
    "an environment of its own": (
        _set("tasks", 1, "task", "env_id", value="SPRL/Easy-v1"),
        "tasks.1.task.env_id: it is SPRL/Easy-v1, the suite's is SPRL/KeyDoors-7x7-v1",
        '"env_id": "SPRL/Easy-v1"',
    ),
    "one run under two seeds": (
        _copy_run,
        "results[3].seed is 3, but its curves are those of seed 1",
        '"seed": 3',
    ),
    "no fingerprint": (_set("tasks", 0, "fingerprint", value=""), "tasks.0.fingerprint", '"fingerprint": ""'),
    "no version of numpy": (_forget_version, "versions has no numpy", '"versions"'),
    "two versions of numpy": (
        _set("versions", "numpy", value="2.4.6, 2.5.0"),
        "versions.numpy is '2.4.6, 2.5.0'",
        '"numpy"',
    ),
    "another name": (_set("agent", value="better"), "belongs in grid-7x7/better.json", "{"),
}


@pytest.mark.parametrize("name", INVALID)
def test_an_invalid_entry_is_refused_with_file_line_and_place(name: str, home: Path) -> None:
    change, message, mark = INVALID[name]
    path = home / "grid-7x7" / "ppo.json"
    edit(path, change)
    [complaint] = leaderboard.validate([path])
    assert complaint.startswith(f"{path}:")
    assert message in complaint
    assert "\n" not in complaint
    number = int(complaint.removeprefix(f"{path}:").partition(":")[0])
    assert mark in path.read_text().splitlines()[number - 1]
    with pytest.raises(InvalidFileError, match=re.escape(message)):
        leaderboard.boards(home)


@pytest.mark.parametrize("content", [b"", b"{", b"NaN", b'{"agent": 1e999}', b"[" * 9_999, b"\xff", b'{"a":1,"a":2}'])
def test_no_file_stops_the_check_of_the_others(content: bytes, home: Path) -> None:
    broken = home / "grid-7x7" / "broken.json"
    broken.write_bytes(content)
    complaints = leaderboard.validate([broken, home / "nowhere.json", home, home / "grid-7x7" / "ppo.json"])
    assert len(complaints) == 3
    assert complaints[0].startswith(f"{broken}:1: ")
    assert complaints[1] == f"{home / 'nowhere.json'}: No such file or directory"


def test_an_entry_takes_no_other_place(home: Path, grid_7x7: list[RunRecord]) -> None:
    leaderboard.entry_path(home, "grid-7x7", "ppo").rename(home / "ppo.json")
    with pytest.raises(InvalidFileError, match=r"belongs in grid-7x7/ppo\.json"):
        leaderboard.read_entry(home / "ppo.json")


def test_an_entry_of_an_earlier_version_of_its_suite_is_named_and_left_out(
    home: Path, caplog: pytest.LogCaptureFixture
) -> None:
    edit(home / "grid-7x7" / "ppo.json", _set("suite_version", value=0))
    [board] = leaderboard.boards(home)
    assert [row.agent for row in board.rows] == ["random"]
    assert f"Left out, for an earlier version of the suite: {home / 'grid-7x7' / 'ppo.json'}." in caplog.text
    [complaint] = leaderboard.validate([home / "grid-7x7" / "ppo.json"])
    assert complaint.endswith("suite_version: it is 0; suite 'grid-7x7' has 1")
