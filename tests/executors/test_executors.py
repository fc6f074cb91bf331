"""Ray and Slurm against stand-ins that do what their libraries document; no cluster takes part."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from types import SimpleNamespace
from typing import Any

import pytest

from sprl_bench.executors import WorkerDiedError, make_executor
from sprl_bench.records import RunSpec
from sprl_bench.suite import expand
from sprl_bench.tasks import find_suite


def specs(count: int, **arguments: Any) -> list[RunSpec]:
    return expand(find_suite("smoke"), ["random"], range(count), **arguments)


def seed_of(spec: RunSpec) -> int:
    if spec.seed == 2:
        raise MemoryError("worker ran out of memory")
    return spec.seed


class FakeRay(SimpleNamespace):
    """Runs a task when it is waited for, the youngest first."""

    def __init__(self) -> None:
        super().__init__(options=[], cancelled=[], most=0)

    def init(self, *, ignore_reinit_error: bool) -> None:
        assert ignore_reinit_error

    def remote(self, function: Callable[..., Any]) -> Any:
        def options(**chosen: Any) -> Any:
            self.options.append(chosen)
            return SimpleNamespace(remote=lambda spec: (function, spec))

        return SimpleNamespace(options=options)

    def wait(self, tasks: Sequence[Any], *, num_returns: int) -> tuple[list[Any], list[Any]]:
        self.most = max(self.most, len(tasks))
        return [tasks[-1]], list(tasks[:-1])

    def get(self, task: Any) -> Any:
        function, spec = task
        return function(spec)

    def cancel(self, task: Any) -> None:
        self.cancelled.append(task)


@pytest.fixture
def ray(monkeypatch: pytest.MonkeyPatch) -> FakeRay:
    fake = FakeRay()
    monkeypatch.setitem(sys.modules, "ray", fake)
    monkeypatch.setattr(RunSpec, "__hash__", lambda self: self.seed, raising=False)
    return fake


def test_ray_gives_back_every_result_and_every_crash(ray: FakeRay) -> None:
    results = {spec.seed: result for spec, result in make_executor("ray", 2).map(seed_of, specs(4))}
    assert {seed: result for seed, result in results.items() if seed != 2} == {0: 0, 1: 1, 3: 3}
    assert isinstance(results[2], WorkerDiedError)
    assert "out of memory" in str(results[2])
    assert ray.most == 2
    assert ray.options[0]["num_cpus"] == 1
    assert ray.options[0]["num_gpus"] == 0
    assert ray.options[0]["max_retries"] == 0
    assert ray.options[0]["runtime_env"]["env_vars"]["OMP_NUM_THREADS"] == "1"


def test_ray_takes_as_many_as_there_are_and_a_gpu_where_one_is_asked_for(ray: FakeRay) -> None:
    list(make_executor("ray", 0).map(seed_of, specs(5, device="cuda", torch_threads=3)))
    assert ray.most == 5
    assert (ray.options[0]["num_gpus"], ray.options[0]["num_cpus"]) == (1, 3)


def test_ray_cancels_what_is_under_way(ray: FakeRay) -> None:
    results = make_executor("ray", 3).map(seed_of, specs(5))
    next(iter(results))
    results.close()  # type: ignore[attr-defined] # a generator
    assert len(ray.cancelled) == 2


class FakeJob:
    def __init__(self, function: Callable[..., Any], spec: RunSpec) -> None:
        self.spec, self.polls, self.cancelled = spec, 0, False
        self._error: Exception | None = None
        try:
            self._result = function(spec)
        except MemoryError as error:
            self._error = error

    def done(self) -> bool:
        self.polls += 1
        return self.polls > self.spec.seed

    def exception(self) -> Exception | None:
        return self._error

    def result(self) -> Any:
        return self._result

    def cancel(self) -> None:
        self.cancelled = True


class FakeSubmitit(SimpleNamespace):
    def __init__(self) -> None:
        super().__init__(parameters=[], jobs=[])

    def AutoExecutor(self, *, folder: str) -> Any:
        assert folder == "slurm-logs"
        return SimpleNamespace(update_parameters=lambda **given: self.parameters.append(given), submit=self._submit)

    def _submit(self, function: Callable[..., Any], spec: RunSpec) -> FakeJob:
        self.jobs.append(FakeJob(function, spec))
        return self.jobs[-1]


@pytest.fixture
def submitit(monkeypatch: pytest.MonkeyPatch) -> FakeSubmitit:
    fake = FakeSubmitit()
    monkeypatch.setitem(sys.modules, "submitit", fake)
    monkeypatch.setattr("sprl_bench.executors.clusters.POLL_S", 0.01)
    return fake


def test_slurm_gives_back_every_result_and_every_crash(submitit: FakeSubmitit) -> None:
    results = {spec.seed: result for spec, result in make_executor("slurm", 2).map(seed_of, specs(4))}
    assert {seed: result for seed, result in results.items() if seed != 2} == {0: 0, 1: 1, 3: 3}
    assert "out of memory" in str(results[2])
    assert submitit.parameters[3]["name"] == "random-FourRooms-7x7-3"
    assert submitit.parameters[3]["cpus_per_task"] == 1
    assert "export OMP_NUM_THREADS=1" in submitit.parameters[3]["slurm_setup"]


def test_slurm_cancels_what_is_under_way(submitit: FakeSubmitit) -> None:
    results = make_executor("slurm", 0).map(seed_of, specs(5))
    next(iter(results))
    results.close()  # type: ignore[attr-defined] # a generator
    assert [job.cancelled for job in submitit.jobs] == [False, True, True, True, True]


@pytest.mark.parametrize(
    ("name", "workers", "message"),
    [
        ("lokal", 1, "Unknown executor 'lokal'; did you mean 'local'"),
        ("local", -1, "workers is -1; it must be an integer of at least 0"),
        ("local", 1.5, "workers is 1.5"),
    ],
)
def test_a_bad_executor_is_named(name: str, workers: Any, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        make_executor(name, workers)


@pytest.mark.parametrize(("name", "module"), [("ray", "ray"), ("slurm", "submitit")])
def test_a_missing_extra_says_how_to_get_it(name: str, module: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(ModuleNotFoundError, match=rf"pip install 'sprl-bench\[{name}\]'"):
        make_executor(name, 1)
