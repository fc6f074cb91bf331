"""Sinks: what arrives there, also after an interruption, and that none can harm a run."""

from __future__ import annotations

import logging
import sys
from pathlib import Path
from typing import Any

import pytest

from cli_calls import Capture, call
from sprl_bench.records import RunSpec
from sprl_bench.run import InterruptedRunError, run
from sprl_bench.sinks import FOLDER, find_sink
from sprl_bench.suite import expand
from sprl_bench.tasks import find_suite

pytestmark = pytest.mark.usefixtures("fakes")

EXAMPLE = '''
import json


class Tracker:
    """A sink of a dozen lines: one JSON object an update, for all runs in one file."""

    def __init__(self, spec, folder, env_steps):
        self.run, self.file = f"{spec.agent}/{spec.seed}", folder.parents[3] / "tracked.jsonl"

    def write(self, env_steps, metrics):
        with self.file.open("a") as file:
            print(json.dumps({"run": self.run, "step": env_steps, **metrics}), file=file)


class Broken(Tracker):
    def write(self, env_steps, metrics):
        raise OSError("the tracker is down")


def refusing(spec, folder, env_steps):
    raise RuntimeError("no account")


number = 3
'''


@pytest.fixture
def tracker(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "my_tracker.py").write_text(EXAMPLE)
    monkeypatch.syspath_prepend(tmp_path)
    sys.modules.pop("my_tracker", None)


def walker(**overrides: Any) -> RunSpec:
    [spec] = expand(find_suite("smoke"), ["harness_fakes:walker"], [0], budget=1000, overrides=overrides)
    return spec


def scalars(folder: Path) -> list[tuple[int, float]]:
    """Return the steps and values of `updates`, as TensorBoard itself reads them."""
    from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

    events = EventAccumulator(str(folder / FOLDER)).Reload()
    return [(event.step, event.value) for event in events.Scalars("updates")]


def test_tensorboard_reads_what_was_logged(tmp_path: Path) -> None:
    spec = walker(rollout=50)
    run(spec, tmp_path, log="tensorboard")
    steps = [150, 300, 450, 600, 750, 900, 1002]  # the last update ends with the budget
    assert scalars(spec.path(tmp_path)) == list(zip(steps, range(1, 8), strict=True))


def test_after_an_interruption_no_step_is_there_twice(tmp_path: Path) -> None:
    spec, calls = walker(rollout=10), iter(range(100))
    with pytest.raises(InterruptedRunError):
        run(spec, tmp_path, log="tensorboard", stop=lambda: next(calls) == 4)
    run(spec, tmp_path, log="tensorboard")
    steps = [step for step, _ in scalars(spec.path(tmp_path))]
    assert steps == sorted(set(steps))
    assert steps[-1] >= 1000


def test_a_sink_of_ones_own(tmp_path: Path, tracker: None) -> None:
    spec = walker(rollout=100)
    run(spec, tmp_path / "runs", log="my_tracker:Tracker")
    lines = (tmp_path / "runs" / "tracked.jsonl").read_text().splitlines()
    assert len(lines) == -(-1000 // (100 * spec.num_envs))
    assert '"run": "walker/0"' in lines[0]
    assert "NaN" not in lines[0]


def test_a_sink_that_fails_changes_nothing(tmp_path: Path, tracker: None, caplog: pytest.LogCaptureFixture) -> None:
    plain = run(walker(), tmp_path / "plain")
    for name, complaint in {
        "my_tracker:Broken": "Nothing more is logged to my_tracker:Broken: OSError('the tracker is down').",
        "my_tracker:refusing": "Nothing is logged to my_tracker:refusing: RuntimeError('no account').",
    }.items():
        caplog.clear()
        with caplog.at_level(logging.WARNING, "sprl_bench"):
            tracked = run(walker(), tmp_path / name.partition(":")[2], log=name)
        assert [message for message in caplog.messages if "logged" in message] == [complaint]
        assert tracked.return_curve == plain.return_curve


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("tensorbord", "Unknown log 'tensorbord'; did you mean 'tensorboard'.*package.module:factory"),
        ("my_tracker:number", "log is 'my_tracker:number'; it must name a callable factory"),
        ("my_tracker:nothing", "log is 'my_tracker:nothing'; it must name a callable factory"),
    ],
)
def test_what_is_no_sink_is_refused(name: str, message: str, tracker: None) -> None:
    with pytest.raises(ValueError, match=message):
        find_sink(name)


def test_on_the_command_line(capsys: Capture, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    command = ["run", "--suite", "smoke", "--agents", "random", "--seeds", "1", "--budget", "600", "--workers", "1"]
    status, _, _ = call(capsys, *command, "--log", "tensorboard", "--out", tmp_path)
    assert status == 0
    assert len(list(tmp_path.rglob("events.out.tfevents.*"))) == 1
    monkeypatch.setitem(sys.modules, "tensorboard", None)
    status, _, err = call(capsys, *command, "--log", "tensorboard", "--out", tmp_path / "other")
    assert status != 0
    assert (
        "tensorboard is not installed; install it with: pip install -c constraints.txt 'sprl-bench[tensorboard]'" in err
    )
    assert not (tmp_path / "other").exists()
