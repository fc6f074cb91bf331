"""What must not stop a suite, lose a run, or reach outside of a run's folder."""

from __future__ import annotations

import json
import multiprocessing
import os
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import gymnasium
import pytest

import sprl_bench
from cli_calls import Capture, call
from script_runs import make, play
from sprl_bench.checkpoint import load
from sprl_bench.executors import make_executor
from sprl_bench.records import InvalidFileError, RunRecord, RunSpec, find_records, folder, read
from sprl_bench.records.folder import CHECKPOINT, EPISODES, ERROR, LOCK, METRICS, RECORD, SPEC, WEIGHTS
from sprl_bench.run import InterruptedRunError, run
from sprl_bench.suite import expand, run_suite, survey
from sprl_bench.tasks import find_suite

AS_ROOT = os.geteuid() == 0


def specs(agent: str = "random", seeds: int = 1, budget: int = 2_000) -> list[RunSpec]:
    return expand(find_suite("smoke"), [agent], range(seeds), budget=budget)


class Here:
    """Runs in this process."""

    def map(self, function: Any, waiting: Any) -> Iterator[Any]:
        for spec in waiting:
            yield spec, function(spec)


def interrupted(out: Path, budget: int = 6_000) -> RunSpec:
    [spec] = specs("ppo", budget=budget)
    with pytest.raises(InterruptedRunError):
        run(spec, out, stop=lambda: True)
    return spec


# --------------------------------------------------------------------------- diagnostics that were lost


@pytest.mark.parametrize("lost", [1, 100, 10**9])
def test_shortened_diagnostics_are_set_aside_and_stop_nothing(
    lost: int, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    spec = interrupted(tmp_path)
    metrics = spec.path(tmp_path) / METRICS
    content = metrics.read_bytes()
    metrics.write_bytes(content[: max(0, len(content) - lost)])
    record = run(spec, tmp_path)
    assert record.status == "complete"
    assert "has lost lines, which no score depends on" in caplog.text
    assert b"\0" not in metrics.read_bytes()
    assert (metrics.parent / f"{METRICS}.broken").read_bytes() == content[: max(0, len(content) - lost)]
    assert survey(tmp_path)[0].status == "finished"


def test_broken_lines_of_diagnostics_do_not_hide_a_run(tmp_path: Path) -> None:
    spec = interrupted(tmp_path)
    with (spec.path(tmp_path) / METRICS).open("ab") as file:
        file.write(b"\0" * 600 + b"}\n[1]\n")
    [state] = survey(tmp_path)
    assert (state.status, state.env_steps) == ("interrupted", 1_536)


# --------------------------------------------------------------------------- links


@pytest.mark.parametrize("name", [SPEC, RECORD, EPISODES, WEIGHTS, CHECKPOINT])
def test_a_linked_file_in_a_runs_folder_is_replaced_not_followed(name: str, tmp_path: Path) -> None:
    [spec] = specs("ppo")
    place, elsewhere = spec.path(tmp_path / "runs"), tmp_path / "precious"
    place.mkdir(parents=True)
    elsewhere.write_bytes(b"precious")
    if name not in (RECORD, CHECKPOINT):  # these would be read first
        (place / name).symlink_to(elsewhere)
    else:
        (place / name).symlink_to(tmp_path / "nowhere")
    run(spec, tmp_path / "runs")
    assert elsewhere.read_bytes() == b"precious"
    assert not (tmp_path / "nowhere").exists()
    assert not (place / name).is_symlink()


@pytest.mark.parametrize("name", [METRICS, LOCK])
def test_a_linked_file_that_grows_is_refused(name: str, tmp_path: Path) -> None:
    [spec] = specs()
    place, elsewhere = spec.path(tmp_path / "runs"), tmp_path / "precious"
    place.mkdir(parents=True)
    elsewhere.write_bytes(b"precious")
    (place / name).symlink_to(elsewhere)
    with pytest.raises(OSError, match=f"{name} is a link; it must be a file"):
        run(spec, tmp_path / "runs")
    assert elsewhere.read_bytes() == b"precious"


def test_a_linked_folder_of_a_run_is_found_everywhere(capsys: Capture, tmp_path: Path) -> None:
    first, second = specs(seeds=2)
    run(first, tmp_path / "runs")
    run(second, tmp_path / "scratch")
    second.path(tmp_path / "runs").symlink_to(second.path(tmp_path / "scratch"))
    second.path(tmp_path / "scratch").joinpath("loop").symlink_to(tmp_path / "scratch")
    assert [one.spec.seed for one in find_records(tmp_path / "runs")] == [0, 1]
    assert [one.status for one in survey(tmp_path / "runs")] == ["finished"] * 2
    status, printed, err = call(capsys, "table", tmp_path / "runs", "--format", "json")
    assert status == 0, err
    assert json.loads(printed)[0]["rows"][0]["seeds"] == [0, 1]


@pytest.mark.parametrize("depth", [0, 1, 3])
@pytest.mark.parametrize("is_link", [True, False])
def test_a_link_that_points_nowhere_or_a_file_is_no_folder(
    is_link: bool, depth: int, capsys: Capture, tmp_path: Path
) -> None:
    words = ["run", "--suite", "smoke", "--agents", "random", "--seeds", 1, "--budget", 500, "--workers", 1]
    seed = tmp_path / "runs" / "custom" / "FourRooms-7x7-500" / "random" / "seed-0"
    place = (seed, *seed.parents)[depth]
    place.parent.mkdir(parents=True)
    place.symlink_to("nowhere") if is_link else place.touch()
    status, out, err = call(capsys, *words, "--out", tmp_path / "runs")
    what = "is a link that points nowhere; it must be a folder." if is_link else "is not a folder; it must be one."
    assert status == 1
    assert f"{place} {what}" in err
    assert "Traceback" not in out + err
    assert place.is_symlink() == is_link
    assert not (place.parent / "nowhere").exists()


# --------------------------------------------------------------------------- one broken run among others


def test_a_run_that_cannot_begin_fails_alone(tmp_path: Path) -> None:
    several = specs(seeds=4)
    broken, blocked = (spec.path(tmp_path) for spec in several[:2])
    broken.mkdir(parents=True)
    (broken / RECORD).write_text('{"no": "record"}')
    blocked.parent.mkdir(parents=True, exist_ok=True)
    blocked.write_text("a file where a folder should be")
    outcomes = run_suite(several, tmp_path, executor=Here())  # type: ignore[arg-type]
    assert [one.status for one in outcomes] == ["failed", "failed", "finished", "finished"]
    assert str(broken / RECORD) in outcomes[0].error
    assert str(blocked) in outcomes[1].error


def test_a_broken_run_of_another_seed_stops_nothing(tmp_path: Path) -> None:
    one, other = specs(seeds=2)
    other.path(tmp_path).mkdir(parents=True)
    (other.path(tmp_path) / RECORD).write_text("broken")
    [outcome] = run_suite([one], tmp_path, executor=Here())  # type: ignore[arg-type]
    assert outcome.status == "finished"


@pytest.mark.skipif(AS_ROOT, reason="root may read everything")
def test_a_folder_that_may_not_be_read_is_named(tmp_path: Path) -> None:
    [spec] = specs()
    run(spec, tmp_path)
    spec.path(tmp_path).chmod(0)
    with pytest.raises(PermissionError, match="seed-0"):
        find_records(tmp_path)
    spec.path(tmp_path).chmod(0o700)


def test_a_sound_checkpoint_that_cannot_be_read_is_not_called_broken(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    spec = interrupted(tmp_path)
    path = spec.path(tmp_path) / CHECKPOINT
    content = path.read_bytes()

    def refuse(self: Path, *arguments: Any, **keywords: Any) -> Any:
        if self.name == CHECKPOINT:
            raise PermissionError(13, "Permission denied", str(self))
        return opened(self, *arguments, **keywords)

    opened = Path.open
    monkeypatch.setattr(Path, "open", refuse)
    with pytest.raises(PermissionError):
        load(path)
    with pytest.raises(PermissionError):
        run(spec, tmp_path)
    monkeypatch.undo()
    assert path.read_bytes() == content


def test_what_a_killed_process_left_is_removed_by_the_next_command(tmp_path: Path) -> None:
    [spec] = specs()
    run(spec, tmp_path)
    place = spec.path(tmp_path)
    for name in (CHECKPOINT, f".{RECORD}.0a1b2c3d", f".{ERROR}.0a1b2c3d"):
        (place / name).write_bytes(b"left")
    run_suite([spec], tmp_path, executor=Here())  # type: ignore[arg-type]
    assert sorted(path.name for path in place.iterdir()) == sorted([EPISODES, METRICS, RECORD, SPEC])


@pytest.mark.parametrize("kind", ["fifo", "device", "large"])
def test_a_record_that_is_no_file_of_its_size_is_refused(
    kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / RECORD
    if kind == "fifo":
        os.mkfifo(path)
    elif kind == "device":
        path.symlink_to("/dev/zero")
    else:
        monkeypatch.setattr("sprl_bench.records.files.LARGEST", 100)
        path.write_bytes(b" " * 101)
    expected = "it must have at most 100" if kind == "large" else "is not a regular file"
    with pytest.raises(InvalidFileError, match=expected):
        read(path, RunRecord)


@pytest.mark.parametrize("text", ["\x1b[2Jgone", "lone \ud800 surrogate", "x" * 10_000_000, "line\nline"])
def test_an_agents_error_is_one_short_printable_line(text: str, tmp_path: Path) -> None:
    class Failing:
        def map(self, function: Any, waiting: Any) -> Iterator[Any]:
            for spec in waiting:
                yield spec, function(spec)

    def fail(*_: Any, **__: Any) -> None:
        raise RuntimeError(text)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("sprl_bench.suite.execute.run", fail)
        [outcome] = run_suite(specs(), tmp_path, executor=Failing())  # type: ignore[arg-type]
    assert outcome.error.isprintable()
    assert outcome.error.startswith("RuntimeError: ")
    assert len(outcome.error) < 500
    assert (specs()[0].path(tmp_path) / ERROR).stat().st_size < 1_000_000


# --------------------------------------------------------------------------- file systems and locks


@pytest.mark.parametrize("number", folder.NO_LOCKS)
def test_a_file_system_without_locks_works_with_one_warning(
    number: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def refuse(*_: Any) -> None:
        raise OSError(number, os.strerror(number))

    folder._warn_of_no_locks.cache_clear()
    monkeypatch.setattr(folder.fcntl, "flock", refuse)
    for spec in specs(seeds=2):
        assert run(spec, tmp_path).status == "complete"
    assert [one.status for one in survey(tmp_path)] == ["finished"] * 2
    assert caplog.text.count("has no locks; never let two processes work on the same run") == 1


# --------------------------------------------------------------------------- processes


def leaves_a_thread(spec: RunSpec) -> int:
    threading.Thread(target=time.sleep, args=(600,)).start()
    return spec.seed


def test_a_thread_that_does_not_end_does_not_hold_up_the_suite(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sprl_bench.executors.local.PARTING_S", 0.5)
    begun = time.monotonic()
    results = {spec.seed: result for spec, result in make_executor("local", 1).map(leaves_a_thread, specs(seeds=2))}
    assert results == {0: 0, 1: 1}
    assert time.monotonic() - begun < 120


def test_no_module_of_the_current_folder_is_executed(tmp_path: Path) -> None:
    for name in ("pickle", "gymnasium", "numpy"):
        (tmp_path / f"{name}.py").write_text("open('executed', 'w').close()\nraise SystemExit(9)\n")
    command = Path(sys.executable).with_name("sprl-bench")
    words = ["run", "--suite", "smoke", "--agents", "random", "--seeds", "1", "--budget", "1000", "--out", "runs"]
    done = subprocess.run([command, *words], cwd=tmp_path, capture_output=True, text=True, check=False, timeout=120)
    assert done.returncode == 0, done.stderr
    assert not (tmp_path / "executed").exists()


def step_in_child(env: Any, box: Any) -> None:
    try:
        env.step(0)
        box.put("stepped")
    except RuntimeError as error:
        box.put(str(error))


def test_a_step_in_a_forked_process_is_refused(tmp_path: Path) -> None:
    env = sprl_bench.record(make(), out=tmp_path, agent="mine", seed=0, budget=100)
    env.reset(seed=0)
    context = multiprocessing.get_context("fork")
    box = context.Queue()
    child = context.Process(target=step_in_child, args=(env, box))
    child.start()
    told = box.get(timeout=60)
    child.join()
    assert "record the environment in the process that steps it" in told
    env.close()


# --------------------------------------------------------------------------- a full disk at the end


def test_a_record_that_cannot_be_written_is_written_by_close(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    env = sprl_bench.record(gymnasium.make("SPRL/FourRooms-7x7-v1"), out=tmp_path, agent="mine", seed=0, budget=100)

    def full(*_: Any, **__: Any) -> None:
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr("sprl_bench.recorder.script_run.write_result", full)
        play(env, 120)
    assert "the record is not written yet" in caplog.text
    assert not list(tmp_path.rglob(RECORD))
    env.close()
    [record] = find_records(tmp_path)
    assert (record.status, record.totals.env_steps) == ("complete", 100)
