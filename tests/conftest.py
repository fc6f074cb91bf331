"""Made-up runs: records with known curves, for all that reads records and never trains."""

from __future__ import annotations

import hashlib
import signal
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import hypothesis
import numpy as np
import pytest

from sprl_bench import leaderboard, records
from sprl_bench.records import Hardware, RunRecord, RunSpec, Scores, TaskSpec, Totals
from sprl_bench.tasks import SUITES

hypothesis.settings.register_profile("patient", deadline=None)  # a busy machine is no failure
hypothesis.settings.load_profile("patient")

# A shell starts what it puts into the background with Ctrl-C ignored, and all that it starts would ignore it, too.
signal.signal(signal.SIGINT, signal.default_int_handler)

MakeRecord = Callable[..., RunRecord]


def fingerprint_of(name: str) -> str:
    """Return a made-up fingerprint."""
    return hashlib.sha256(name.encode()).hexdigest()[:16]


def synthetic_record(
    agent: str = "ppo",
    task: str = "FourRooms-7x7",
    seed: int = 0,
    *,
    suite: str = "smoke",
    curve: Any = None,
    level: float = 0.5,
    privileged: bool = False,
    hyperparameters: dict[str, Any] | None = None,
    task_changes: dict[str, Any] | None = None,
    suite_version: int | None = None,
    **changes: Any,
) -> RunRecord:
    """Return a run whose curve is `curve`, or `level` everywhere."""
    values = tuple(np.full(100, level).tolist() if curve is None else np.asarray(curve, dtype=float).tolist())
    task_spec = TaskSpec.of(SUITES[suite].task(task)).model_copy(update=task_changes or {})
    chosen = {"learning_rate": 0.001} if hyperparameters is None else hyperparameters
    spec = RunSpec(
        suite=suite,
        suite_version=SUITES[suite].version if suite_version is None else suite_version,
        task=task_spec,
        agent=agent,
        source=f"made_up:{agent}",
        privileged=privileged,
        hyperparameters=chosen,
        hyperparameters_hash=records.hyperparameters_hash(chosen),
        seed=seed,
        num_envs=12,
    )
    steps = task_spec.budget if changes.get("status") != "incomplete" else task_spec.budget // 2
    fields: dict[str, Any] = {
        "spec": spec,
        "status": "complete",
        "return_curve": values,
        "success_curve": values,
        "scores": Scores.of(task_spec, values, values),
        "totals": Totals(env_steps=steps, episodes=100, successes=50, mean_return=0.5, mean_length=50.0),
        "fingerprint": fingerprint_of(task),
        "versions": {"python": "3.11.7", "numpy": "2.4.6", "sprl-bench": "0.1.0"},
        "git_commit": None,
        "hardware": Hardware(cpu="made up", cores=2, memory_gib=8.0),
        "wall_time_s": 1.5,
        "peak_memory_mib": 100.0,
    }
    return RunRecord(**{**fields, **changes})


@pytest.fixture(scope="session")
def make_record() -> MakeRecord:
    return synthetic_record


@pytest.fixture
def grid_7x7() -> list[RunRecord]:
    """Two agents, two tasks, five seeds; every curve flat."""
    levels = {"ppo": 0.5, "random": 0.1}
    return [
        synthetic_record(agent, task, seed, suite="grid-7x7", level=level + 0.01 * seed + 0.1 * task.startswith("Key"))
        for agent, level in levels.items()
        for task in ("FourRooms-7x7", "KeyDoors-7x7")
        for seed in range(5)
    ]


@pytest.fixture
def rising() -> list[RunRecord]:
    """Five seeds whose scores all differ: those of one run, and those of one kind."""
    runs = []
    for seed in range(5):
        curve, success = np.linspace(0, 0.2 + 0.15 * seed, 100) ** 2, np.linspace(0, 0.1 + 0.2 * seed, 100)
        run = synthetic_record("rising", seed=seed, curve=curve)
        scores = Scores.of(run.spec.task, curve.tolist(), success.tolist())
        runs.append(run.model_copy(update={"success_curve": tuple(success.tolist()), "scores": scores}))
    return runs


@pytest.fixture
def home(grid_7x7: list[RunRecord], tmp_path: Path) -> Path:
    """A folder of boards: that of grid-7x7 with an entry of each of the two agents."""
    about = {"authors": ["Ada L."], "link": "https://example.org/paper_1"}
    for agent in ("ppo", "random"):
        leaderboard.add_entry(leaderboard.make_entry(grid_7x7, agent=agent, **about), tmp_path / "boards")
    return tmp_path / "boards"


@pytest.fixture
def write_runs(tmp_path: Path) -> Callable[[list[RunRecord]], Path]:
    """Return a function that writes records where a run would have, and returns their root."""

    def write(runs: list[RunRecord]) -> Path:
        root = tmp_path / "runs"
        for run in runs:
            records.write(run.spec.path(root) / "record.json", run)
        return root

    return write


@pytest.fixture
def fakes(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the test, and the worker processes that it starts, import the modules in tests/fakes."""
    monkeypatch.syspath_prepend(Path(__file__).parent / "fakes")


@pytest.fixture(autouse=True)
def numbers_stay_exact() -> Iterator[None]:
    """Fail a test that leaves the processor flushing small numbers to 0, which would break others far from it."""
    yield
    assert float.fromhex("0x1p-1022") / 2 > 0, "the test leaves the processor flushing denormal numbers to 0"
