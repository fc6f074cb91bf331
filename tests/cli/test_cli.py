"""The command line: what it prints, what it writes, and that each mistake is one line and an exit status."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from cli_calls import Capture, call, refused
from sprl_bench import records, shipped
from sprl_bench.agents import agent_names
from sprl_bench.envs import IDS
from sprl_bench.records import RunRecord
from sprl_bench.tasks import SUITES

MakeRecord = Callable[..., RunRecord]
WriteRuns = Callable[[list[RunRecord]], Path]
SCORE = ["--author", "Ada L.", "--link", "https://example.org"]


@pytest.fixture
def runs(grid_7x7: list[RunRecord], write_runs: WriteRuns) -> Path:
    return write_runs(grid_7x7)


def test_lists_what_there_is(capsys: Capture) -> None:
    assert call(capsys, "list", "envs") == (0, "\n".join(IDS) + "\n", "")
    assert call(capsys, "list", "agents") == (0, "\n".join(agent_names()) + "\n", "")
    _, suites, _ = call(capsys, "list", "suites")
    assert [line.split()[0] for line in suites.splitlines()[1:]] == list(SUITES)
    _, tasks, _ = call(capsys, "list", "tasks")
    rows = [" ".join(line.split()) for line in tasks.splitlines()]
    assert "smoke FourRooms-7x7 SPRL/FourRooms-7x7-v1 100,000" in rows
    assert len(tasks.splitlines()) == 1 + sum(len(suite.tasks) for suite in SUITES.values())


def test_help_and_version(capsys: Capture) -> None:
    status, out, _ = call(capsys, "--help")
    assert status == 0
    for command in ("run", "status", "table", "plot", "leaderboard", "list", "video", "doctor"):
        assert f"\n  {command} " in out
    assert call(capsys, "--version") == (0, "sprl-bench 0.1.0\n", "")
    assert call(capsys, "run", "--help")[0] == 0


@pytest.mark.parametrize("words", [[], ["list"], ["leaderboard"]])
def test_a_missing_command_is_answered_with_the_help(words: list[str], capsys: Capture) -> None:
    status, out, _ = call(capsys, *words)
    assert status == 2
    assert "Commands:" in out


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["tabel"], "No such command 'tabel'"),
        (["table"], "Missing argument"),
        (["table", "--forma", "md"], "No such option: --forma"),
        (["run", "--suite", "smoke"], "Missing option '--agents'"),
        (["run", "--suite", "smke", "--agents", "random"], f"'smoke'? Allowed: {', '.join(sorted(SUITES))}."),
        (["run", "--suite", "smoke", "--agents", "randm"], "did you mean 'random'?"),
        (["run", "--suite", "smoke", "--agents", "random,random"], "more than once"),
        (["run", "--suite", "smoke", "--agents", ","], "agents is ','"),
        (["run", "--suite", "smoke", "--agents", "random", "--task", "FourRoms-7x7"], "did you mean 'FourRooms-7x7'"),
        (["run", "--suite", "smoke", "--agents", "random", "--seeds", "many"], "seeds is 'many'"),
        (["run", "--suite", "smoke", "--agents", "random", "--seeds", "0"], "seeds is '0'"),
        (["run", "--suite", "smoke", "--agents", "random", "--seeds", "3,3"], "seeds holds 3 more than once"),
        (["run", "--suite", "smoke", "--agents", "random", "--budget", "0"], "--budget"),
        (["run", "--suite", "smoke", "--agents", "random", "--budget", "1e3"], "Invalid value for '--budget'"),
        (["run", "--suite", "smoke", "--agents", "random", "--workers", "-1"], "--workers"),
        (["run", "--suite", "smoke", "--agents", "random", "--executor", "locl"], "did you mean 'local'?"),
        (["run", "--suite", "smoke", "--agents", "random", "--set", "num_env=3"], "did you mean 'num_envs'?"),
        (["run", "--suite", "smoke", "--agents", "random", "--set", "num_envs"], "must be KEY=VALUE"),
        (["run", "--suite", "smoke", "--agents", "random", "--set", "num_envs=NaN"], "'NaN'; it must be finite"),
        (["table", ".", "--format", "html"], "Unknown format 'html'"),
        (["leaderboard", "show", "grd"], "Unknown leaderboard 'grd'"),
        (["leaderboard", "show", "--format", "html"], "Unknown format 'html'"),
        (["leaderboard", "compare", ".", "--against", ".", "--format", "csv"], "Unknown format 'csv'"),
        (["leaderboard", "add", ".", "--agent", "a", *SCORE, "--status", "true"], "Unknown status 'true'"),
    ],
)
def test_a_wrong_command_is_one_line_and_status_2(
    words: list[str], message: str, capsys: Capture, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    status, line = refused(capsys, *words)
    assert message in line
    assert status == 2
    assert list(tmp_path.iterdir()) == []


def test_what_is_not_there_is_one_line_and_status_1(capsys: Capture, tmp_path: Path) -> None:
    nowhere = tmp_path / "nowhere"
    for words in (
        ["table", nowhere],
        ["status", nowhere],
        ["plot", nowhere, "-o", tmp_path / "a.png"],
        ["leaderboard", "add", nowhere, "--agent", "ppo", *SCORE],
        ["leaderboard", "compare", tmp_path, "--against", nowhere],
        ["run", "--suite", "smoke", "--agents", "nowhere.module:agent", "--out", nowhere],
    ):
        status, line = refused(capsys, *words)
        assert (status, "nowhere" in line) == (1, True)
    assert refused(capsys, "status", tmp_path) == (1, f"There are no runs in {tmp_path}.")
    assert refused(capsys, "table", tmp_path) == (1, "There is no finished run to make a table of.")
    assert list(tmp_path.iterdir()) == []


def test_a_broken_record_is_one_line_wherever_it_is_read(capsys: Capture, runs: Path, tmp_path: Path) -> None:
    broken = runs / "grid-7x7/KeyDoors-7x7/ppo/seed-2/record.json"
    broken.write_text(broken.read_text().replace('"auc": 0.62', '"auc": NaN'))
    before = sorted(tmp_path.rglob("*"))
    for words in (
        ["table", runs],
        ["plot", runs, "-o", tmp_path / "a.png"],
        ["leaderboard", "add", runs, "--agent", "ppo", *SCORE, "--home", tmp_path / "boards"],
    ):
        status, line = refused(capsys, *words)
        assert status == 1
        assert line.startswith(f"{broken}:")
        assert "scores.auc: Input should be a finite number, not nan" in line
    assert sorted(tmp_path.rglob("*")) == before


def test_debug_shows_the_traceback_wherever_it_stands(capsys: Capture, tmp_path: Path) -> None:
    for words in (["--debug", "table", tmp_path / "x"], ["table", tmp_path / "x", "--debug"]):
        with pytest.raises(FileNotFoundError):
            call(capsys, *words)


def test_a_bug_of_ours_keeps_its_traceback(capsys: Capture, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def bug(*_: object) -> None:
        raise KeyError("oops")

    monkeypatch.setattr(records, "find_recorded", bug)
    with pytest.raises(KeyError):
        call(capsys, "table", tmp_path)


def test_a_missing_extra_says_how_to_get_it(
    capsys: Capture, runs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    error = ModuleNotFoundError("No module named 'matplotlib'", name="matplotlib")

    def fail(*_: object, **__: object) -> None:
        raise error

    monkeypatch.setattr("sprl_bench.plots.plot", fail)
    status, line = refused(capsys, "plot", runs, "-o", tmp_path / "a.png")
    assert (status, line) == (
        1,
        "matplotlib is not installed; install it with: pip install -c constraints.txt 'sprl-bench[plots]'",
    )


def test_a_table_in_each_format(capsys: Capture, runs: Path, tmp_path: Path) -> None:
    status, out, err = call(capsys, "table", runs)
    assert (status, err) == (0, "")
    assert "Suite grid-7x7, version 1" in out
    assert "\x1b" not in out
    assert json.loads(call(capsys, "table", runs, "--format", "json")[1])[0]["suite"] == "grid-7x7"
    assert call(capsys, "table", runs, "--format", "csv")[1].startswith("suite,suite_version,agent")
    assert "\\begin{tabular}" in call(capsys, "table", runs, "--format", "latex")[1]
    shown = call(capsys, "table", runs, "--format", "md")[1]
    path = tmp_path / "tables" / "grid.md"
    assert call(capsys, "table", runs, "--format", "md", "-o", path) == (0, "", f"Wrote {path}.\n")
    assert path.read_text() == shown


@pytest.mark.parametrize(
    ("suffix", "form"), [("md", "md"), ("csv", "csv"), ("json", "json"), ("tex", "latex"), ("txt", "rich")]
)
def test_a_file_s_name_says_the_format(capsys: Capture, runs: Path, tmp_path: Path, suffix: str, form: str) -> None:
    path = tmp_path / f"table.{suffix}"
    call(capsys, "table", runs, "-o", path)
    assert path.read_text() == call(capsys, "table", runs, "--format", form)[1]


def test_the_package_is_the_command() -> None:
    ran = subprocess.run([sys.executable, "-m", "sprl_bench", "--version"], capture_output=True, text=True, check=True)
    assert ran.stdout.startswith("sprl-bench ")


def test_a_table_of_missing_runs_needs_to_be_asked_for(capsys: Capture, runs: Path) -> None:
    for name in ("record.json", "spec.json"):
        (runs / "grid-7x7/KeyDoors-7x7/ppo/seed-4" / name).unlink(missing_ok=True)
    status, line = refused(capsys, "table", runs)
    assert (status, "KeyDoors-7x7/ppo/seed-4" in line) == (1, True)
    status, out, _ = call(capsys, "table", runs, "--allow-missing")
    assert (status, "4 of 5" in out) == (0, True)
    status, out, _ = call(capsys, "table", runs, "--task", "FourRooms-7x7")
    assert (status, "KeyDoors" in out) == (0, False)
    status, out, _ = call(capsys, "table", runs, "--agent", "random")
    assert (status, "random" in out, "ppo" in out) == (0, True, False)


def test_a_run_that_was_begun_and_has_no_record_is_missing(
    capsys: Capture, make_record: MakeRecord, write_runs: WriteRuns
) -> None:
    root = write_runs([make_record()])
    spec = make_record(seed=1).spec
    records.write(spec.path(root) / "spec.json", spec)
    status, line = refused(capsys, "table", root)
    assert (status, "FourRooms-7x7/ppo/seed-1" in line) == (1, True)


def test_a_picture(capsys: Capture, runs: Path, tmp_path: Path) -> None:
    path = tmp_path / "curves.svg"
    assert call(capsys, "plot", runs, "-o", path, "--task", "KeyDoors-7x7") == (0, "", f"Wrote {path}.\n")
    assert b"<svg" in path.read_bytes()
    assert call(capsys, "plot", runs, "-o", path, "--agent", "ppo")[0] == 0
    assert b"ppo" in path.read_bytes()
    assert b"random" not in path.read_bytes()
    status, line = refused(capsys, "plot", runs, "-o", tmp_path / "curves.gif")
    assert (status, "llowed: .pdf, .png, .svg" in line) == (2, True)


def test_a_picture_of_a_board(
    capsys: Capture, home: Path, make_record: MakeRecord, write_runs: WriteRuns, tmp_path: Path
) -> None:
    path, board = tmp_path / "curves.svg", home / "grid-7x7"
    assert call(capsys, "leaderboard", "plot", board, "-o", path) == (0, "", f"Wrote {path}.\n")
    text = path.read_text()
    assert all(name in text for name in ("ppo (5 seeds)", "random (5 seeds)", "FourRooms-7x7", "KeyDoors-7x7"))
    for kind, label in (("profiles", "Share of runs above"), ("improvement", "P(agent &gt; ppo)")):
        assert call(capsys, "leaderboard", "plot", board, "-o", path, "--kind", kind, "--width", "one-column")[0] == 0
        assert label in path.read_text()
    assert "Unknown kind 'pie'" in refused(capsys, "leaderboard", "plot", board, "-o", path, "--kind", "pie")[1]
    show = ["leaderboard", "show", "grid-7x7", "--home", home, "--format", "latex", "--columns", "Seeds,Mean AUC"]
    assert "IQM" not in call(capsys, *show)[1]

    mine = [make_record("mine", task, suite="grid-7x7") for task in ("FourRooms-7x7", "KeyDoors-7x7")]
    other = make_record("mine", suite="smoke")
    beside = ["leaderboard", "plot", board, "-o", path, "--runs"]
    assert call(capsys, *beside, write_runs([*mine, other]), "--agent", "mine", "--agent", "ppo")[0] == 0
    text = path.read_text()
    assert ["mine (1 seed)" in text, "ppo (5 seeds)" in text, "random" in text] == [True, True, False]

    again = write_runs([make_record("ppo", task, suite="grid-7x7") for task in ("FourRooms-7x7", "KeyDoors-7x7")])
    assert call(capsys, *beside, again)[0] == 0
    assert "ppo of the runs (1 seed)" in path.read_text()
    assert "ppo (5 seeds)" in path.read_text()


def test_a_picture_of_a_board_with_something_missing(
    capsys: Capture, home: Path, make_record: MakeRecord, write_runs: WriteRuns, tmp_path: Path
) -> None:
    path = tmp_path / "curves.svg"
    board = ["leaderboard", "plot", home / "grid-7x7", "-o", path]
    half = make_record("mine", seed=1, suite="grid-7x7")
    beside = [*board, "--runs", write_runs([half])]
    status, line = refused(capsys, *beside)
    assert (status, "KeyDoors-7x7/mine/seed-1" in line, "--allow-missing" in line) == (1, True, True)
    status, line = refused(capsys, *beside, "--agent", "pppo")
    assert (status, "did you mean 'ppo'" in line) == (2, True)
    status, line = refused(capsys, *board, "--task", "FourRooms")
    assert (status, "did you mean 'FourRooms-7x7'" in line) == (2, True)
    (tmp_path / "empty").mkdir()
    status, line = refused(capsys, *board, "--runs", tmp_path / "empty")
    assert (status, line) == (2, f"There is no run of suite 'grid-7x7' in {tmp_path / 'empty'}.")
    assert not path.exists()
    assert call(capsys, *beside, "--allow-missing")[0] == 0
    assert "mine" in path.read_text()


def test_the_way_of_an_entry(capsys: Capture, runs: Path, tmp_path: Path) -> None:
    home = tmp_path / "boards"
    path = home / "grid-7x7" / "ppo.json"
    add = ["leaderboard", "add", runs, "--agent", "ppo", *SCORE, "--home", home]
    assert call(capsys, *add) == (0, "", f"Wrote {path}.\n")
    status, line = refused(capsys, *add)
    assert (status, line) == (1, f"{path} exists; replace it with --replace.")
    assert call(capsys, *add, "--replace", "--status", "reproduced")[0] == 0

    assert call(capsys, "leaderboard", "validate", path) == (0, "1 of 1 entries are valid.\n", "")
    path.write_text(path.read_text().replace('"evidence": "recorded"', '"evidence": "replayed"'))
    out = call(capsys, "leaderboard", "validate", path)[1]
    assert out.endswith("says that it is replayed; only sprl-bench verify, with its runs, can show that.\n")
    path.write_text(path.read_text().replace('"evidence": "replayed"', '"evidence": "recorded"'))
    _, shown, _ = call(capsys, "leaderboard", "show", "--home", home, "--format", "md")
    assert "| ppo | 5 |" in shown
    assert "ppo: reproduced, recorded; Ada L.; https://example.org" in shown
    assert call(capsys, "leaderboard", "show", "grid-7x7", "--home", home, "--format", "md")[1] == shown

    for against in (home / "grid-7x7", path):
        status, out, _ = call(capsys, "leaderboard", "compare", runs, "--against", against, "--format", "json")
        assert status == 0
        assert [(one["agent"], one["entry"]) for one in json.loads(out)] == [("ppo", "ppo"), ("random", "ppo")]
    _, out, _ = call(capsys, "leaderboard", "compare", runs, "--against", path, "--agent", "random")
    assert "random (5 seeds, mean AUC 0.170) minus each entry of suite grid-7x7, version 1" in out
    _, out, _ = call(capsys, "leaderboard", "compare", runs, "--against", path, "--agent", "random", "--seeds", "3,4")
    assert "random (2 seeds, mean AUC 0.185)" in out
    assert refused(
        capsys, "leaderboard", "add", runs, "--agent", "ppo", "--seeds", "0,1", *SCORE, "--home", home, "--replace"
    ) == (1, "An entry needs at least 5 seeds; ppo has 2.")
    assert refused(capsys, "leaderboard", "compare", runs, "--against", path, "--seeds", "4,7,9") == (
        2,
        f"seeds is '4,7,9', but {runs} has no run of seed 7, 9.",
    )


def test_an_entry_is_never_written_into_an_installed_package(
    capsys: Capture, runs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(shipped, "__file__", str(tmp_path / "site" / "sprl_bench" / "shipped.py"))
    (tmp_path / "work").mkdir()
    monkeypatch.chdir(tmp_path / "work")
    add = ["leaderboard", "add", runs, "--agent", "ppo", *SCORE]
    status, line = refused(capsys, *add)
    assert (status, line) == (1, "There is no folder leaderboards here to write to; name one with --home.")
    Path("leaderboards").mkdir()
    assert call(capsys, *add) == (0, "", "Wrote leaderboards/grid-7x7/ppo.json.\n")
    assert not (tmp_path / "site").exists()
    assert refused(capsys, "leaderboard", "show")[1].startswith(
        f"{tmp_path}/site/sprl_bench/_leaderboards has no entry"
    )


def test_an_invalid_entry_is_named_and_the_others_counted(capsys: Capture, runs: Path, tmp_path: Path) -> None:
    home = tmp_path / "boards"
    call(capsys, "leaderboard", "add", runs, "--agent", "ppo", *SCORE, "--home", home)
    good, bad = home / "grid-7x7" / "ppo.json", home / "grid-7x7" / "bad.json"
    bad.write_text('{"agent": 1e999}')
    status, out, err = call(capsys, "leaderboard", "validate", good, bad)
    assert (status, out) == (1, "1 of 2 entries are valid.\n")
    assert err.count("\n") == 1
    assert err.startswith(f"{bad}:1: ")
    status, line = refused(capsys, "leaderboard", "show", "--home", home)
    assert (status, line.startswith(f"{bad}:1: ")) == (1, True)


def test_the_schema_is_printed(capsys: Capture) -> None:
    _, out, _ = call(capsys, "leaderboard", "schema")
    assert json.loads(out)["title"] == "Entry"


def test_help_and_lists_load_nothing_heavy() -> None:
    code = (
        "import sys; from sprl_bench.cli import main\n"
        "for words in (['--help'], ['run', '--help'], ['video', '--help'], ['list', 'envs'], ['list', 'agents'],\n"
        "              ['list', 'tasks']):\n"
        "    assert main(words) == 0\n"
        "heavy = {'torch', 'mujoco', 'numba', 'minigrid', 'pandas', 'pyarrow', 'matplotlib', 'scipy'}\n"
        "sys.exit(', '.join(sorted(heavy & set(sys.modules))) or None)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")


def test_a_reader_that_leaves_is_no_error(runs: Path) -> None:
    code = f"import sys; from sprl_bench.cli import main; sys.exit(main(['table', {str(runs)!r}, '--format', 'json']))"
    buffered = {name: value for name, value in os.environ.items() if name != "PYTHONUNBUFFERED"}
    process = subprocess.Popen(
        [sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=subprocess.PIPE, env=buffered
    )
    assert process.stdout
    assert process.stderr
    process.stdout.close()
    complaint = process.stderr.read()
    process.stderr.close()
    process.wait()
    assert complaint == b""
    assert process.returncode in (0, 1)
