"""Suites: which runs there are, what is done about them, and what is told of them."""

from __future__ import annotations

import io
import json
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import gymnasium
import psutil
import pytest
from rich.console import Console

import sprl_bench
from sprl_bench import run as running
from sprl_bench.durations import duration
from sprl_bench.executors import LocalExecutor, WorkerDiedError, make_executor
from sprl_bench.progress import LiveProgress, PlainProgress, make_observer
from sprl_bench.records import InvalidFileError, RunRecord, RunSpec, read
from sprl_bench.records.folder import LockedError, is_locked, lock
from sprl_bench.resume import SpecChangedError
from sprl_bench.run import InterruptedRunError
from sprl_bench.suite import Observer, Outcome, expand, run_suite, survey
from sprl_bench.tasks import find_suite

pytestmark = pytest.mark.usefixtures("fakes")

SMOKE = find_suite("smoke")
WALKER, BROKEN, DYING = (f"harness_fakes:{name}" for name in ("walker", "broken", "dying"))


class Here:
    """Works on all runs in this process."""

    def map(self, function: Callable[[RunSpec], Any], specs: Sequence[RunSpec]) -> Iterator[tuple[RunSpec, Any]]:
        for spec in specs:
            yield spec, function(spec)


class Listening(Observer):
    def __init__(self) -> None:
        self.heard: list[Any] = []

    def started(self, specs: Sequence[RunSpec], out: Path) -> None:
        self.heard.append(len(specs))

    def ended(self, outcome: Outcome) -> None:
        self.heard.append((outcome.spec.agent, outcome.spec.seed, outcome.status))

    def closed(self) -> None:
        self.heard.append("closed")


def walkers(seeds: Sequence[int] = (0,), budget: int = 300, **overrides: Any) -> list[RunSpec]:
    return expand(SMOKE, [WALKER], seeds, budget=budget, overrides=overrides)


def statuses(outcomes: Sequence[Outcome]) -> list[str]:
    return [outcome.status for outcome in outcomes]


# What is done about them.


def test_the_same_command_again_skips_what_is_finished_and_adds_what_is_new(tmp_path: Path) -> None:
    listening = Listening()
    assert statuses(run_suite(walkers([0]), tmp_path, executor=Here(), observer=listening)) == ["finished"]
    before = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*")}
    outcomes = run_suite(walkers([0, 1]), tmp_path, executor=Here(), observer=listening)
    assert statuses(outcomes) == ["skipped", "finished"]
    assert listening.heard == [
        *(1, ("walker", 0, "finished"), "closed"),
        *(2, ("walker", 0, "skipped"), ("walker", 1, "finished"), "closed"),
    ]
    place = walkers()[0].path(tmp_path)
    assert all(path.stat().st_mtime_ns == before[path] for path in place.iterdir())


def test_outcomes_keep_the_order_of_the_specs(tmp_path: Path) -> None:
    run_suite(walkers([1]), tmp_path, executor=Here())
    outcomes = run_suite(walkers([2, 1, 0]), tmp_path, executor=Here())
    assert [(outcome.spec.seed, outcome.status) for outcome in outcomes] == [
        (2, "finished"),
        (1, "skipped"),
        (0, "finished"),
    ]


def test_a_failing_run_leaves_its_traceback_and_the_others_go_on(tmp_path: Path) -> None:
    specs = expand(SMOKE, [BROKEN, WALKER], [0], budget=300)
    failed, finished = run_suite(specs, tmp_path, executor=Here())
    assert (failed.status, finished.status) == ("failed", "finished")
    assert failed.error == "ZeroDivisionError: the agent divided by zero"
    error = (failed.spec.path(tmp_path) / "error.txt").read_text()
    assert error.startswith("Traceback")
    assert "in _misbehave" in error
    assert [state.status for state in survey(tmp_path)] == ["failed", "finished"]


def test_a_failed_run_is_tried_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import harness_fakes

    (spec,) = expand(SMOKE, [BROKEN], [0], budget=300)
    assert statuses(run_suite([spec], tmp_path, executor=Here())) == ["failed"]
    monkeypatch.setattr(harness_fakes.Walker, "_misbehave", lambda self: None)
    assert statuses(run_suite([spec], tmp_path, executor=Here())) == ["finished"]
    assert not (spec.path(tmp_path) / "error.txt").exists()


def test_a_changed_hyperparameter_is_refused_before_anything_starts(tmp_path: Path) -> None:
    run_suite(walkers([0]), tmp_path, executor=Here())
    before = sorted(tmp_path.rglob("*"))
    listening = Listening()
    changed = [*walkers([0, 1], rollout=25), *expand(SMOKE, ["random"], [0], budget=300)]
    with pytest.raises(SpecChangedError, match="seed-0: rollout: 20 on disk, 25 now"):
        run_suite(changed, tmp_path, executor=Here(), observer=listening)
    assert sorted(tmp_path.rglob("*")) == before
    assert not listening.heard


def test_a_difference_is_told_once_and_many_are_cut_short(tmp_path: Path) -> None:
    run_suite(walkers([0]), tmp_path, executor=Here())
    with pytest.raises(SpecChangedError, match=r"num_envs: 3 on disk, 4 now\. Use another --out") as raised:
        run_suite(walkers([0], num_envs=4), tmp_path, executor=Here())
    assert str(raised.value).count("num_envs") == 1
    with pytest.raises(SpecChangedError, match=r"\(and 1 more\)\. Use another --out"):
        run_suite(walkers([0], num_envs=4, rollout=2, after=3, pause_s=0.5), tmp_path, executor=Here())


def test_more_seeds_under_other_hyperparameters_are_refused_too(tmp_path: Path) -> None:
    """A table takes the mean over all of them."""
    run_suite(walkers([0]), tmp_path, executor=Here())
    with pytest.raises(SpecChangedError, match="seed-0: rollout: 20 on disk, 25 now"):
        run_suite(walkers([1], rollout=25), tmp_path, executor=Here())


def test_a_record_in_the_wrong_folder_is_named_by_where_it_lies(tmp_path: Path) -> None:
    """Else whoever is told to remove it would remove the run that it was copied from."""
    (wanted,) = walkers([0])
    (other,) = expand(SMOKE, ["random"], [0], budget=300)
    run_suite([other], tmp_path, executor=Here())
    place = wanted.path(tmp_path)
    place.mkdir(parents=True)
    (place / "record.json").write_bytes((other.path(tmp_path) / "record.json").read_bytes())
    with pytest.raises(SpecChangedError, match="agent: 'random' on disk") as raised:
        run_suite([wanted], tmp_path, executor=Here())
    assert str(place) in str(raised.value)
    assert str(other.path(tmp_path)) not in str(raised.value)


def test_a_run_that_never_began_may_change(tmp_path: Path) -> None:
    (spec,) = expand(SMOKE, [BROKEN], [0], budget=300)
    run_suite([spec], tmp_path, executor=Here())
    changed = expand(SMOKE, [BROKEN], [0], budget=300, overrides={"num_envs": 2})
    assert statuses(run_suite(changed, tmp_path, executor=Here())) == ["failed"]
    assert read(spec.path(tmp_path) / "spec.json", RunSpec) == changed[0]


def test_a_broken_record_fails_its_run_alone(tmp_path: Path) -> None:
    broken, other = walkers([0, 1])
    run_suite([broken], tmp_path, executor=Here())
    (broken.path(tmp_path) / "record.json").write_text("{")
    outcomes = run_suite([broken, other], tmp_path, executor=Here())
    assert statuses(outcomes) == ["failed", "finished"]
    assert "record.json" in outcomes[0].error
    assert (broken.path(tmp_path) / "record.json").read_text() == "{"


def test_a_run_that_another_command_works_on_is_left_to_it(tmp_path: Path) -> None:
    specs = walkers([0, 1])
    with lock(specs[0].path(tmp_path)):
        outcomes = run_suite(specs, tmp_path, executor=Here())
    assert statuses(outcomes) == ["failed", "finished"]
    assert "is in use by another process" in outcomes[0].error
    assert not (specs[0].path(tmp_path) / "error.txt").exists()


def test_what_a_run_prints_goes_to_a_file(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    (spec,) = walkers(trouble="print", after=2)
    run_suite([spec], tmp_path, executor=Here())
    print("after")
    assert (spec.path(tmp_path) / "output.txt").read_text() == "hello from compiled code\n"
    assert capfd.readouterr() == ("after\n", "")


def test_one_worker_or_three_and_other_load_give_the_same_numbers(tmp_path: Path) -> None:
    """The processes of three workers outnumber most machines' cores; one more keeps a core busy."""
    specs = [*walkers([0, 1], budget=900), *expand(SMOKE, [BROKEN, DYING], [0], budget=900)]
    load = subprocess.Popen([sys.executable, "-c", "while True: pass"])
    try:
        outcomes = run_suite(specs, tmp_path / "three", executor=LocalExecutor(3))
    finally:
        load.kill()
        load.wait()
    assert statuses(outcomes) == ["finished", "finished", "failed", "failed"]
    assert outcomes[3].error == "the worker was ended by SIGKILL (out of memory?)"
    assert "SIGKILL" in (specs[3].path(tmp_path / "three") / "error.txt").read_text()
    assert [state.status for state in survey(tmp_path / "three")] == ["failed", "failed", "finished", "finished"]
    assert statuses(run_suite(specs[:2], tmp_path / "one", executor=make_executor("local", 1))) == ["finished"] * 2
    for spec in specs[:2]:
        one, three = (read(spec.path(tmp_path / out) / "record.json", RunRecord) for out in ("one", "three"))
        for name in ("return_curve", "success_curve", "scores", "totals", "fingerprint"):
            assert getattr(one, name) == getattr(three, name), name
        episodes = [(spec.path(tmp_path / out) / "episodes.parquet").read_bytes() for out in ("one", "three")]
        assert episodes[0] == episodes[1]


def test_workers_have_their_threads_set_before_they_import_anything() -> None:
    before = dict(os.environ)
    (spec,) = expand(SMOKE, ["random"], [0], torch_threads=2)
    ((returned, environment),) = LocalExecutor(1).map(_environment_at_start, [spec])
    assert returned == spec
    assert not isinstance(environment, WorkerDiedError)
    for pool in ("OMP", "MKL", "OPENBLAS", "NUMBA"):
        assert environment[f"{pool}_NUM_THREADS"] == "2"
    assert environment["PYTHONHASHSEED"] == "0"
    assert dict(os.environ) == before


def _environment_at_start(_: RunSpec) -> dict[str, str]:
    """Return what the process was started with, which later changes of its environment do not touch."""
    pairs = Path("/proc/self/environ").read_bytes().split(b"\0")
    return dict(pair.decode().split("=", 1) for pair in pairs if b"=" in pair)


COMMAND = """
import signal
import sys
from pathlib import Path
from sprl_bench.executors import LocalExecutor
from sprl_bench.suite import expand, run_suite
from sprl_bench.tasks import find_suite
if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.default_int_handler)  # where the tests run in the background, it is ignored
    specs = expand(find_suite("smoke"), ["harness_fakes:walker"], [0, 1], budget=6000, overrides={"pause_s": 1.0})
    run_suite(specs, Path(sys.argv[1]), executor=LocalExecutor(2))
"""


@pytest.mark.parametrize("end", ["Ctrl-C", "kill -9"])
def test_whatever_ends_the_command_the_workers_stop_with_checkpoints(tmp_path: Path, end: str) -> None:
    out, script = tmp_path / "runs", tmp_path / "command.py"
    script.write_text(COMMAND)
    search = os.pathsep.join([str(Path(__file__).parents[1] / "fakes"), os.environ.get("PYTHONPATH", "")])
    environment = {**os.environ, "PYTHONPATH": search}
    command = [sys.executable, str(script), str(out)]
    errors = tmp_path / "errors.txt"
    with errors.open("w") as stderr:
        process = subprocess.Popen(command, env=environment, start_new_session=True, stderr=stderr)
    try:
        wait_for(lambda: len(list(out.rglob("metrics.jsonl"))) == 2)
        wait_for(lambda: {state.status for state in survey(out)} == {"running"})
        if end == "Ctrl-C":
            workers = psutil.Process(process.pid).children()
            for one in workers:  # a terminal tells all of them, and the command tells its workers again
                one.send_signal(signal.SIGINT)
            time.sleep(0.1)
            process.send_signal(signal.SIGINT)
        else:
            process.kill()
        process.wait(timeout=120)
        wait_for(lambda: not alive(process.pid))
    finally:
        process.kill()
    assert process.returncode == -(signal.SIGINT if end == "Ctrl-C" else signal.SIGKILL)
    if end == "kill -9":
        assert errors.read_text() == ""  # nobody is left to hear of it
    assert [state.status for state in survey(out)] == ["interrupted", "interrupted"]
    for state in survey(out):
        assert (state.spec.path(out) / "checkpoint.safetensors").exists()
        assert not (state.spec.path(out) / "error.txt").exists()


def wait_for(condition: Callable[[], bool]) -> None:
    deadline = time.monotonic() + 200
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.05)


def alive(group: int) -> bool:
    """Return whether anything of a process group still runs; what nobody has waited for does not."""

    def runs(process: psutil.Process) -> bool:
        try:
            return os.getpgid(process.pid) == group and process.status() != psutil.STATUS_ZOMBIE
        except (ProcessLookupError, psutil.NoSuchProcess):
            return False

    return any(map(runs, psutil.process_iter()))


# What is told of them.


def test_survey_tells_what_is_left_and_for_how_long(tmp_path: Path) -> None:
    finished, waiting, cut, going = walkers([0, 1, 2, 3])
    run_suite([finished], tmp_path, executor=Here())
    for spec in (waiting, cut, going):
        sprl_bench.records.write(spec.path(tmp_path) / "spec.json", spec)
    stops = iter([False, True])
    with pytest.raises(InterruptedRunError):
        running.run(cut, tmp_path, stop=lambda: next(stops))
    learned = {60: (0.25, 0.5), 120: (0.5, 0.75), 180: (None, None)}  # no episode ended before the last line
    metrics = [
        {"env_steps": steps, "wall_time_s": steps / 50, "return": reward, "success": success}
        for steps, (reward, success) in learned.items()
    ]
    text = "".join(json.dumps(line) + "\n" for line in metrics)
    (going.path(tmp_path) / "metrics.jsonl").write_text(text + '{"env_steps": 24')
    with lock(going.path(tmp_path)):
        states = survey(tmp_path)
    assert [(state.spec.seed, state.status, state.env_steps) for state in states] == [
        (0, "finished", 300),
        (1, "waiting", 0),
        (2, "interrupted", 120),
        (3, "running", 180),
    ]
    assert states[3].steps_per_second == pytest.approx(50)
    assert states[3].seconds_left == pytest.approx(120 / 50)
    assert (states[3].mean_return, states[3].success) == (0.5, 0.75)
    assert states[1].mean_return is None
    assert states[0].seconds_left == 0
    assert states[1].seconds_left is None


def test_survey_knows_the_runs_of_scripts(tmp_path: Path) -> None:
    env = sprl_bench.record(gymnasium.make("SPRL/FourRooms-7x7-v1"), out=tmp_path, agent="mine", seed=0)
    env.reset()
    env.step(0)
    env.close()
    (state,) = survey(tmp_path)
    assert (state.spec.agent, state.status, state.env_steps) == ("mine", "interrupted", 1)


def test_survey_takes_any_way_to_the_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (spec,) = walkers([0])
    run_suite([spec], tmp_path / "runs", executor=Here())
    (tmp_path / "link").symlink_to(tmp_path / "runs")
    monkeypatch.chdir(spec.path(tmp_path / "runs").parent)
    for way in (Path(), Path(".."), tmp_path / "link", spec.path(tmp_path / "runs")):
        assert [state.spec for state in survey(way)] == [spec]


def test_survey_refuses_a_run_in_the_folder_of_another(tmp_path: Path) -> None:
    (spec,) = walkers([0])
    run_suite([spec], tmp_path, executor=Here())
    folder = spec.path(tmp_path)
    folder.rename(folder.with_name("seed-3"))
    with pytest.raises(InvalidFileError, match=r"seed-3 holds the run that belongs in custom/.*/walker/seed-0; move"):
        survey(tmp_path)


def test_survey_of_nothing(tmp_path: Path) -> None:
    assert survey(tmp_path) == []
    with pytest.raises(FileNotFoundError, match="nowhere does not exist"):
        survey(tmp_path / "nowhere")


def test_plain_progress_prints_lines(tmp_path: Path) -> None:
    stream = io.StringIO()
    assert isinstance(make_observer(stream), PlainProgress)
    observer = PlainProgress(stream, every_s=1e6)
    run_suite(expand(SMOKE, [WALKER, BROKEN], [0], budget=300), tmp_path, executor=Here(), observer=observer)
    assert stream.getvalue().splitlines() == [
        "finished: walker on FourRooms-7x7-300, seed 0",
        "failed: broken on FourRooms-7x7-300, seed 0: ZeroDivisionError: the agent divided by zero",
        "1/2 runs, 360/600 env steps",
    ]


def test_plain_progress_prints_now_and_then(tmp_path: Path) -> None:
    stream = io.StringIO()
    observer = PlainProgress(stream, every_s=0.05)
    observer.started(walkers([0, 1]), tmp_path)
    wait_for(lambda: stream.getvalue().count("\n") > 1)
    observer.closed()
    lines = stream.getvalue().splitlines()
    assert lines[0] == "0/2 runs, 0/600 env steps, 0 steps/s, ? left"


def test_runs_too_short_to_tell_their_speed_have_the_mean_one(tmp_path: Path) -> None:
    """No run is running when the folders are read, but one has ended since the start."""
    stream = io.StringIO()
    observer = PlainProgress(stream, every_s=0.05)
    first, second = walkers([0, 1])
    observer.started([first, second], tmp_path)
    run_suite([first], tmp_path, executor=Here())
    wait_for(lambda: "1/2 runs" in stream.getvalue())
    observer.closed()
    line = next(line for line in stream.getvalue().splitlines() if "1/2 runs" in line and "left" in line)
    assert re.search(r"300/600 env steps, [1-9][\d,]* steps/s, \d.* left", line), line


def test_live_progress_draws_what_is_running(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TERM", "xterm")
    (spec,) = walkers()
    stream = io.StringIO()
    observer = LiveProgress(Console(file=stream, force_terminal=True, width=120, no_color=True))
    sprl_bench.records.write(spec.path(tmp_path) / "spec.json", spec)
    (spec.path(tmp_path) / "metrics.jsonl").write_text(
        '{"env_steps": 60, "wall_time_s": 2.0, "return": 0.5, "success": 0.75}\n'
    )
    with lock(spec.path(tmp_path)):
        observer.started([spec], tmp_path)
        observer.ended(Outcome(replace_seed(spec), "failed", "it [broke]"))
        time.sleep(0.7)
        observer.closed()
    text = stream.getvalue()
    assert "walker on FourRooms-7x7-300, seed 0" in text
    assert "30 steps/s" in text
    assert "8 s left" in text
    assert "return 0.50, success 0.75" in text
    assert "failed: walker on FourRooms-7x7-300, seed 9: it [broke]" in text


def replace_seed(spec: RunSpec) -> RunSpec:
    return spec.model_copy(update={"seed": 9})


@pytest.mark.parametrize(
    ("seconds", "text"),
    [(0.0, "0 s"), (59.4, "59 s"), (59.6, "1 min 00 s"), (185, "3 min 05 s"), (7800, "2 h 10 min"), (None, "?")],
)
def test_durations_read_well(seconds: float | None, text: str) -> None:
    assert duration(seconds) == text


def test_a_lock_is_seen_and_ends_with_its_holder(tmp_path: Path) -> None:
    assert not is_locked(tmp_path)
    with lock(tmp_path):
        assert is_locked(tmp_path)
        with pytest.raises(LockedError), lock(tmp_path):
            pass
        assert is_locked(tmp_path)
    assert not is_locked(tmp_path)
    code = "import os, sys; from pathlib import Path; from sprl_bench.records.folder import lock\n"
    code += "with lock(Path(sys.argv[1])): os.kill(os.getpid(), 9)"
    subprocess.run([sys.executable, "-c", code, str(tmp_path)], check=False, timeout=120)
    assert (tmp_path / ".lock").exists()
    with lock(tmp_path):
        pass
    assert not list(tmp_path.iterdir())
