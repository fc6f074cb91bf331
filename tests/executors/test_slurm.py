"""Runs as jobs of submitit's own stand-in for Slurm, on this machine: finished, crashed, cancelled and preempted."""

from __future__ import annotations

import functools
import logging
import os
import signal
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import psutil
import pytest

from sprl_bench.executors import WorkerDiedError, clusters, make_executor
from sprl_bench.records import RunSpec, find_records
from sprl_bench.records.folder import METRICS
from sprl_bench.run import run
from sprl_bench.suite import expand, run_suite
from sprl_bench.tasks import find_suite

submitit = pytest.importorskip("submitit")


@pytest.fixture(autouse=True)
def local(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(clusters, "CLUSTER", "local")
    monkeypatch.setattr(clusters, "POLL_S", 0.2)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("OMP_NUM_THREADS", "1")


def specs(count: int, agent: str = "random", budget: int = 3_000) -> list[RunSpec]:
    return expand(find_suite("smoke"), [agent], range(count), budget=budget)


def seed_of(spec: RunSpec) -> int:
    if spec.seed == 2:
        raise MemoryError("worker ran out of memory")
    if spec.seed == 3:
        os.kill(os.getpid(), signal.SIGKILL)
    return spec.seed


def test_every_result_and_every_crash_comes_back() -> None:
    results = {spec.seed: result for spec, result in make_executor("slurm", 2).map(seed_of, specs(4))}
    assert {seed: results[seed] for seed in (0, 1)} == {0: 0, 1: 1}
    assert all(isinstance(results[seed], WorkerDiedError) for seed in (2, 3))


def test_a_suite_gives_the_records_that_it_gives_here(tmp_path: Path) -> None:
    outcomes = run_suite(specs(2), Path("there"), executor=make_executor("slurm", 2))
    assert [one.status for one in outcomes] == ["finished"] * 2, outcomes
    here = [run(spec, tmp_path / "here") for spec in specs(2)]
    there = find_records(tmp_path / "there")
    assert [(one.spec, one.return_curve, one.totals) for one in there] == [
        (one.spec, one.return_curve, one.totals) for one in here
    ]


class Watched:
    """Slurm's executor, whose jobs can be seen from outside."""

    def __init__(self) -> None:
        self.executor: Any = make_executor("slurm", 0)
        self.jobs: list[Any] = []
        start = self.executor._start

        def begun(function: Any, spec: RunSpec) -> Any:
            self.jobs.append(start(function, spec))
            return self.jobs[-1]

        self.executor._start = begun


def begun(root: Path) -> bool:
    return any(path.stat().st_size for path in root.rglob(METRICS))


def test_a_preempted_job_is_queued_again_and_gives_the_same_record(tmp_path: Path) -> None:
    watched, [spec] = Watched(), specs(1, "ppo", 12_000)
    preempted = []
    look = watched.executor._ended

    def ended(calls: Sequence[Any]) -> Any:
        if not preempted and begun(tmp_path / "there"):
            [task] = psutil.Process(watched.jobs[0]._process.pid).children()
            task.send_signal(signal.SIGUSR2)  # as Slurm does
            preempted.append(task.pid)
        return look(calls)

    watched.executor._ended = ended
    [outcome] = run_suite([spec], Path("there"), executor=watched.executor)
    assert preempted
    assert outcome.status == "finished", outcome.error
    assert not psutil.pid_exists(preempted[0])
    [there] = find_records(tmp_path / "there")
    here = run(spec, tmp_path / "here")
    assert (there.return_curve, there.totals) == (here.return_curve, here.totals)


def test_a_suite_that_is_closed_waits_for_its_jobs(tmp_path: Path) -> None:
    before = psutil.Process().children(recursive=True)
    watched, [spec] = Watched(), specs(1, "ppo", 900_000)
    attempt = functools.partial(run, out=tmp_path / "there")
    work = watched.executor.map(attempt, [spec])
    look = watched.executor._ended

    def ended(calls: Sequence[Any]) -> Any:
        if begun(tmp_path / "there"):
            raise KeyboardInterrupt
        return look(calls)

    watched.executor._ended = ended
    with pytest.raises(KeyboardInterrupt):
        next(work)
    assert all(job.done() for job in watched.jobs)
    assert not set(psutil.Process().children(recursive=True)) - set(before)


def test_without_slurm_nothing_is_started(monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture) -> None:
    monkeypatch.setattr(clusters, "CLUSTER", "slurm")
    monkeypatch.setenv("PATH", "")
    with caplog.at_level(logging.WARNING), pytest.raises(clusters.NoClusterError, match="there is no `srun` here"):
        make_executor("slurm", 1)
