"""One run: what it writes, how it goes on after an interruption, and what it refuses."""

from __future__ import annotations

import hashlib
import json
import logging
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sprl_bench import checkpoint, provenance, scores
from sprl_bench.agents import load_factory, resolve_hyperparameters
from sprl_bench.process import torch_set_up
from sprl_bench.records import RunRecord, RunSpec, read, write
from sprl_bench.records.folder import LockedError, lock
from sprl_bench.resume import CheckpointRefusedError, SpecChangedError
from sprl_bench.run import InterruptedRunError, env_seed, make_envs, run
from sprl_bench.tasks import CUSTOM, find_suite, with_budget

pytestmark = pytest.mark.usefixtures("fakes")

BUDGET = 1000
Change = dict[str, Any]


def make_spec(
    agent: str = "harness_fakes:walker", budget: int = BUDGET, seed: int = 0, num_envs: int = 3, **overrides: Any
) -> RunSpec:
    factory = load_factory(agent)
    chosen = resolve_hyperparameters(factory, "grid", {**overrides, "num_envs": num_envs})
    return RunSpec.of(
        CUSTOM,
        with_budget(find_suite("smoke").tasks[0], budget),
        hyperparameters=chosen.values,
        agent=agent.partition(":")[2] or agent,
        source=agent,
        privileged=False,
        seed=seed,
        num_envs=chosen.num_envs,
    )


def after(count: int) -> Callable[[], bool]:
    """Return a `stop` that asks for it at the given yield."""
    calls = iter(range(1, 10**6))
    return lambda: next(calls) == count


def lines(folder: Path) -> list[dict[str, Any]]:
    found = [json.loads(line) for line in (folder / "metrics.jsonl").read_text().splitlines()]
    return [{name: value for name, value in line.items() if name != "wall_time_s"} for line in found]


def episodes(folder: Path) -> dict[str, list[Any]]:
    import pyarrow.parquet

    columns: dict[str, list[Any]] = pyarrow.parquet.read_table(folder / "episodes.parquet").to_pydict()
    return columns


def assert_same_run(one: Path, other: Path) -> None:
    """Compare all but the time it took and where."""
    first, second = (read(folder / "record.json", RunRecord) for folder in (one, other))
    for name in ("spec", "status", "return_curve", "success_curve", "scores", "totals", "fingerprint"):
        assert getattr(first, name) == getattr(second, name), name
    assert episodes(one) == episodes(other)
    assert lines(one) == lines(other)


@pytest.fixture(scope="module")
def uninterrupted(tmp_path_factory: pytest.TempPathFactory) -> Path:
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(Path(__file__).parent / "fakes")
        spec = make_spec()
        out = tmp_path_factory.mktemp("uninterrupted")
        run(spec, out)
    return spec.path(out)


def test_a_run_writes_its_record_episodes_and_metrics(uninterrupted: Path) -> None:
    record = read(uninterrupted / "record.json", RunRecord)
    assert sorted(path.name for path in uninterrupted.iterdir()) == [
        "episodes.parquet",
        "metrics.jsonl",
        "record.json",
        "spec.json",
    ]
    assert (record.status, record.spec) == ("complete", read(uninterrupted / "spec.json", RunSpec))
    table = episodes(uninterrupted)
    assert len(table["stamp"]) == record.totals.episodes > 5
    assert record.return_curve == tuple(scores.curve(table["stamp"], table["return"], BUDGET).tolist())
    assert record.totals.env_steps == BUDGET
    assert [line["env_steps"] for line in lines(uninterrupted)] == [*range(60, BUDGET, 60), 1002]
    assert lines(uninterrupted)[3] == {
        "env_steps": 240, "return": None, "success": None, "updates": 4.0, "loss": None
    }  # fmt: skip
    assert record.wall_time_s > 0
    assert record.peak_memory_mib > 10


@pytest.mark.parametrize("seed", [0, 3])
def test_the_record_is_what_the_environment_gave(tmp_path: Path, seed: int) -> None:
    """Replay the agent's actions in a vector environment of one's own, and count in plain Python."""
    spec = make_spec(seed=seed)
    run(spec, tmp_path)
    envs = make_envs(spec.task.env_id, 3, {})
    envs.reset(seed=env_seed(spec))
    envs.reset()
    generator, returns, expected = np.random.default_rng(seed), [0.0] * 3, []
    for step in range(BUDGET // 3 + 1):
        _, rewards, terminated, truncated, _ = envs.step(generator.integers(3, size=3))
        for index in range(3):
            returns[index] += float(rewards[index])
            if terminated[index] or truncated[index]:
                expected.append((step * 3 + index + 1, returns[index], bool(terminated[index])))
                returns[index] = 0.0
    table = episodes(spec.path(tmp_path))
    found = list(zip(table["stamp"], table["return"], table["success"], strict=True))
    assert found == [row for row in expected if row[0] <= BUDGET]


@pytest.mark.parametrize("cuts", [[1], [2], [7], [16], [3, 1, 5], [1, 1, 1]])
def test_an_interrupted_run_comes_to_the_same(tmp_path: Path, uninterrupted: Path, cuts: list[int]) -> None:
    spec = make_spec()
    for cut in cuts:
        with pytest.raises(InterruptedRunError, match="env steps; the same command continues from there"):
            run(spec, tmp_path, stop=after(cut))
        assert not (spec.path(tmp_path) / "record.json").exists()
    run(spec, tmp_path)
    assert_same_run(spec.path(tmp_path), uninterrupted)
    assert not (spec.path(tmp_path) / "checkpoint.safetensors").exists()


def test_a_run_of_many_commits_still_fits_its_record(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    commits = [f"{number:040}-dirty" for number in range(9)]
    for commit in commits[:-1]:
        monkeypatch.setattr(provenance, "git_commit", lambda commit=commit: commit)
        with pytest.raises(InterruptedRunError):
            run(make_spec(), tmp_path, stop=after(1))
    monkeypatch.setattr(provenance, "git_commit", lambda: commits[-1])
    assert run(make_spec(), tmp_path).git_commit == f"{commits[0]}, 7 others, {commits[-1]}"


@pytest.mark.parametrize(
    ("count", "text"), [(0, None), (1, "{0}"), (6, "{0}, {1}, {2}, {3}, {4}, {5}"), (7, "{0}, 5 others, {6}")]
)
def test_commits_are_joined_in_one_line(count: int, text: str | None) -> None:
    commits = [f"{number:040}-dirty" for number in range(count)]
    joined = replace(provenance.Provenance.take(""), git_commits=tuple(commits)).git_commit
    assert joined == (text and text.format(*commits))
    assert len(joined or "") <= 300


def test_checkpoints_change_nothing(tmp_path: Path, uninterrupted: Path) -> None:
    spec = make_spec()
    run(spec, tmp_path, checkpoint_every_s=0)
    assert_same_run(spec.path(tmp_path), uninterrupted)


def test_ppo_goes_on_to_the_last_bit(tmp_path: Path) -> None:
    spec = make_spec("ppo", 800, num_envs=4, rollout_length=32)
    run(spec, tmp_path / "whole")
    for cut in (1, 4):
        with pytest.raises(InterruptedRunError):
            run(spec, tmp_path / "cut", stop=after(cut))
    run(spec, tmp_path / "cut")
    assert_same_run(spec.path(tmp_path / "cut"), spec.path(tmp_path / "whole"))
    assert lines(spec.path(tmp_path / "cut"))[-1]["env_steps"] == 800


KILLED = """
import sys
from pathlib import Path
from sprl_bench.records import RunSpec, read
from sprl_bench.run import run
if __name__ == "__main__":
    run(read(Path(sys.argv[1]), RunSpec), Path(sys.argv[2]), checkpoint_every_s=0)
"""


def kill_in_the_middle(spec: RunSpec, out: Path, updates: int) -> None:
    """Start the run in a process of its own, and kill it once it has written so many lines."""
    write(out / "wanted.json", spec)
    file = spec.path(out) / "metrics.jsonl"
    process = subprocess.Popen([sys.executable, "-c", KILLED, str(out / "wanted.json"), str(out)])
    try:
        deadline = time.monotonic() + 120
        while not (file.exists() and file.read_bytes().count(b"\n") >= updates):
            assert process.poll() is None
            assert time.monotonic() < deadline
            time.sleep(0.002)
    finally:
        process.kill()
        process.wait()
    assert process.returncode == -signal.SIGKILL
    assert not (spec.path(out) / "record.json").exists()


@pytest.mark.parametrize(
    ("agent", "changes", "kills"),
    [("random", {"budget": 60_000}, (2, 6)), ("ppo", {"budget": 2500, "num_envs": 4, "rollout_length": 32}, (3,))],
)
def test_a_killed_run_goes_on_exactly(tmp_path: Path, agent: str, changes: Change, kills: tuple[int, ...]) -> None:
    spec = make_spec(agent, **changes)
    for updates in kills:
        kill_in_the_middle(spec, tmp_path, updates)
    checkpoint.load(spec.path(tmp_path) / "checkpoint.safetensors")
    run(spec, tmp_path)
    run(spec, tmp_path / "whole")
    assert_same_run(spec.path(tmp_path), spec.path(tmp_path / "whole"))
    assert not [path for path in spec.path(tmp_path).iterdir() if path.name.startswith(".")]


def test_a_finished_run_is_not_run_again(tmp_path: Path) -> None:
    spec = make_spec(budget=60)
    first = run(spec, tmp_path)
    before = (spec.path(tmp_path) / "record.json").stat().st_mtime_ns
    assert run(spec, tmp_path) == first
    assert (spec.path(tmp_path) / "record.json").stat().st_mtime_ns == before


def test_a_signal_lets_the_update_finish_and_saves(tmp_path: Path, uninterrupted: Path) -> None:
    before = signal.getsignal(signal.SIGTERM)
    spec = make_spec(trouble="terminate", after=4)
    with pytest.raises(InterruptedRunError, match="after 240 env steps"):
        run(spec, tmp_path)
    assert signal.getsignal(signal.SIGTERM) is before
    run(spec, tmp_path)
    assert episodes(spec.path(tmp_path)) == episodes(uninterrupted)


def test_an_agent_that_cannot_save_starts_over_and_says_so(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    spec = make_spec("harness_fakes:forgetful")
    with pytest.raises(InterruptedRunError, match="the same command starts it over"):
        run(spec, tmp_path, stop=after(5))
    assert not (spec.path(tmp_path) / "checkpoint.safetensors").exists()
    run(spec, tmp_path)
    assert "starts over when interrupted" in caplog.text
    assert lines(spec.path(tmp_path))[0]["env_steps"] == 60
    assert len(lines(spec.path(tmp_path))) == 17


def test_environments_that_cannot_save_start_over(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    spec = make_spec("random", 2000, num_envs=2)
    task = spec.task.model_copy(update={"env_id": "CartPole-v1", "name": "CartPole"})
    spec = spec.model_copy(update={"task": task})
    with pytest.raises(InterruptedRunError):
        run(spec, tmp_path, stop=after(1))
    record = run(spec, tmp_path)
    assert "starts over" in caplog.text
    assert record.totals.mean_return == pytest.approx(record.totals.mean_length)


def interrupted(spec: RunSpec, out: Path) -> Path:
    with pytest.raises(InterruptedRunError):
        run(spec, out, stop=after(5))
    return spec.path(out) / "checkpoint.safetensors"


@pytest.mark.parametrize("length", [0, 100, -1])
def test_a_broken_checkpoint_is_discarded_with_a_word(
    tmp_path: Path, uninterrupted: Path, length: int, caplog: pytest.LogCaptureFixture
) -> None:
    path = interrupted(make_spec(), tmp_path)
    path.write_bytes(path.read_bytes()[:length])
    run(make_spec(), tmp_path)
    assert "is not a whole checkpoint" in caplog.text
    assert "starts over" in caplog.text
    assert_same_run(path.parent, uninterrupted)


def test_a_checkpoint_of_other_versions_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = interrupted(make_spec(), tmp_path)
    before, versions = path.read_bytes(), provenance.versions()
    monkeypatch.setattr(provenance, "versions", lambda: {**versions, "numpy": "9.9"})
    with pytest.raises(CheckpointRefusedError, match=f"numpy {versions['numpy']} then, 9.9 now"):
        run(make_spec(), tmp_path)
    assert path.read_bytes() == before


def test_a_checkpoint_without_provenance_is_of_another_build(tmp_path: Path) -> None:
    path = interrupted(make_spec(), tmp_path)
    state = checkpoint.load(path)
    del state["provenance"]
    checkpoint.save(path, state)
    with pytest.raises(CheckpointRefusedError, match=r"was made by another build of sprl-bench \(provenance\)"):
        run(make_spec(), tmp_path)


def test_a_package_that_is_loaded_later_is_looked_at_too(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    interrupted(make_spec(), tmp_path)
    loaded = {name: version for name, version in provenance.versions().items() if name != "numpy"}
    monkeypatch.setattr(provenance, "versions", lambda: loaded)
    monkeypatch.setattr(provenance, "installed", {"numpy": "9.9"}.get)
    with pytest.raises(CheckpointRefusedError, match=r"numpy \S+ then, 9\.9 now"):
        run(make_spec(), tmp_path)


def test_a_checkpoint_of_other_code_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "edited_agent.py"
    file.write_text("from harness_fakes import walker\n")
    monkeypatch.syspath_prepend(tmp_path)
    spec = make_spec().model_copy(update={"source": "edited_agent:walker"})
    path = interrupted(spec, tmp_path)
    before = path.read_bytes()
    file.write_text("from harness_fakes import walker  # and something else\n")
    with pytest.raises(CheckpointRefusedError, match="made with other code of edited_agent:walker: restore that code"):
        run(spec, tmp_path)
    assert path.read_bytes() == before
    file.write_text("from harness_fakes import walker\n")
    assert run(spec, tmp_path).agent_code == hashlib.sha256(file.read_bytes()).hexdigest()[:16]


def test_an_installed_agent_has_no_code_of_its_own() -> None:
    assert provenance.agent_code("ppo") is None
    assert provenance.agent_code("") == provenance.agent_code("__main__:script")
    assert provenance.agent_code("not.loaded:agent") is None


def test_another_processor_is_warned_of(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    interrupted(make_spec(), tmp_path)
    here = provenance.hardware()
    monkeypatch.setattr(provenance, "hardware", lambda: here.model_copy(update={"cpu": "Abacus"}))
    assert run(make_spec(), tmp_path).status == "complete"
    assert f"was made on another CPU model ({here.cpu} then, Abacus now)" in caplog.text


@pytest.mark.parametrize(("device", "wanted"), [("cpu", False), ("cuda", True)])
def test_a_gpu_has_to_give_the_same_bits(device: str, wanted: bool) -> None:
    torch = pytest.importorskip("torch")
    with torch_set_up(make_spec().model_copy(update={"device": device})):
        assert torch.are_deterministic_algorithms_enabled() is wanted
    assert not torch.are_deterministic_algorithms_enabled()


def test_steps_and_time_are_the_harness_s_own(tmp_path: Path) -> None:
    spec = make_spec(trouble="boast", budget=60)
    run(spec, tmp_path)
    (line,) = lines(spec.path(tmp_path))
    assert line["env_steps"] == 60


def test_a_checkpoint_of_another_run_is_refused(tmp_path: Path) -> None:
    path = interrupted(make_spec(), tmp_path / "one")
    place = make_spec(seed=1).path(tmp_path / "other")
    place.mkdir(parents=True)
    path.rename(place / path.name)
    with pytest.raises(CheckpointRefusedError, match="is of another run: seed: 0 on disk, 1 now"):
        run(make_spec(seed=1), tmp_path / "other")


def test_a_changed_hyperparameter_is_refused_with_the_difference(tmp_path: Path) -> None:
    interrupted(make_spec(), tmp_path)
    with pytest.raises(SpecChangedError, match="rollout: 20 on disk, 30 now"):
        run(make_spec(rollout=30), tmp_path)
    run(make_spec(), tmp_path)
    with pytest.raises(SpecChangedError, match="num_envs: 3 on disk, 4 now"):
        run(make_spec(num_envs=4), tmp_path)


@pytest.mark.parametrize(
    ("trouble", "error", "message"),
    [
        ("raise", ZeroDivisionError, "divided by zero"),
        ("stop", RuntimeError, "Agent 'walker' stopped after 180 of 1000 env steps"),
    ],
)
def test_a_failing_agent_leaves_no_record(tmp_path: Path, trouble: str, error: type[Exception], message: str) -> None:
    spec = make_spec(trouble=trouble, after=3)
    with pytest.raises(error, match=message):
        run(spec, tmp_path)
    assert not (spec.path(tmp_path) / "record.json").exists()
    with lock(spec.path(tmp_path)):  # and no lock
        pass


def test_one_process_at_a_time(tmp_path: Path) -> None:
    with lock(make_spec().path(tmp_path)), pytest.raises(LockedError, match=f"process {os.getpid()} on"):
        run(make_spec(), tmp_path)


@pytest.mark.parametrize("failing", ["episodes.parquet", "record.json"])
def test_a_full_disk_at_the_end_leaves_the_checkpoint(
    tmp_path: Path, uninterrupted: Path, failing: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    from sprl_bench.records import files

    path = interrupted(make_spec(), tmp_path)
    before, replace = path.read_bytes(), Path.replace

    def full(self: Path, target: Path) -> Path:
        if target.name == failing:
            raise OSError(28, "No space left on device")
        return replace(self, target)

    with monkeypatch.context() as patch:
        patch.setattr(files.Path, "replace", full)
        with pytest.raises(OSError, match="No space left"):
            run(make_spec(), tmp_path)
    assert path.read_bytes() == before
    assert not (path.parent / "record.json").exists()
    assert not [left for left in path.parent.iterdir() if left.name.startswith(".")]
    run(make_spec(), tmp_path)
    assert_same_run(path.parent, uninterrupted)


def test_leftovers_of_a_killed_write_are_removed(tmp_path: Path) -> None:
    folder = make_spec(budget=60).path(tmp_path)
    folder.mkdir(parents=True)
    (folder / ".checkpoint.safetensors.12ab34cd").write_bytes(b"half")
    (folder / ".record.json.12ab34cd").write_bytes(b"{")
    run(make_spec(budget=60), tmp_path)
    assert not [path for path in folder.iterdir() if path.name.startswith(".")]


def test_streams_of_two_runs_share_no_seed() -> None:
    seeds = [env_seed(make_spec(seed=seed, budget=budget)) for seed in range(100) for budget in (100, 200)]
    assert all(0 <= seed < 2**31 for seed in seeds)
    near = np.diff(np.sort(seeds))
    assert near.min() > 12


def test_the_seed_of_the_streams_never_changes() -> None:
    """A changed derivation would move every score."""
    assert env_seed(make_spec(seed=0)) == 364038052


def test_the_process_is_set_up_as_the_spec_says_and_put_back(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import harness_fakes
    import torch

    seen = []

    def look(_: Any) -> None:
        seen.append((torch.get_num_threads(), float(torch.tensor(1e-310, dtype=torch.float64) * 0.5)))

    before = torch.get_num_threads()
    monkeypatch.setattr(harness_fakes.Walker, "_misbehave", look)
    run(make_spec(budget=60, after=1).model_copy(update={"torch_threads": before + 1}), tmp_path)
    assert seen == [(before + 1, 0.0)]
    assert torch.get_num_threads() == before
    assert float(torch.tensor(1e-310, dtype=torch.float64) * 0.5) > 0


def test_a_run_without_torch_does_not_load_it(tmp_path: Path) -> None:
    write(tmp_path / "wanted.json", make_spec("random", 3072, num_envs=12))
    code = f"{KILLED}\n    assert 'torch' not in sys.modules and 'pandas' not in sys.modules"
    subprocess.run([sys.executable, "-c", code, str(tmp_path / "wanted.json"), str(tmp_path)], check=True, timeout=120)


def test_the_streams_are_the_run_s_and_no_agent_can_seed_them(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import harness_fakes

    def train(self: Any, envs: Any, budget: int) -> Any:
        assert envs.unwrapped.np_random_seed == tuple(env_seed(make_spec(budget=60)) + index for index in range(3))
        envs.reset(seed=4)

    monkeypatch.setattr(harness_fakes.Walker, "train", train)
    with pytest.raises(ValueError, match=r"seed is 4, but these environments are seeded by the run"):
        run(make_spec(budget=60), tmp_path)


def test_resuming_is_said(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    interrupted(make_spec(), tmp_path)
    with caplog.at_level(logging.INFO, "sprl_bench"):
        run(make_spec(), tmp_path)
    assert "continues after 300 env steps" in caplog.text


def test_each_line_of_metrics_has_the_means_of_the_episodes_since_the_line_before(tmp_path: Path) -> None:
    """Interrupted or not, each episode is in one line, and the weighted means are the record's own."""
    whole, parts = make_spec(), make_spec()
    run(whole, tmp_path / "whole")
    with pytest.raises(InterruptedRunError):
        run(parts, tmp_path / "parts", stop=after(2))
    run(parts, tmp_path / "parts")
    found, again = lines(whole.path(tmp_path / "whole")), lines(parts.path(tmp_path / "parts"))
    assert [(line["return"], line["success"]) for line in found] == [(one["return"], one["success"]) for one in again]
    ended = episodes(whole.path(tmp_path / "whole"))
    before = 0
    for line in found:
        rows = [n for n, stamp in enumerate(ended["stamp"]) if before < stamp <= line["env_steps"]]
        before = line["env_steps"]
        for name in ("return", "success"):
            expected = float(np.mean([ended[name][row] for row in rows])) if rows else None
            assert line[name] == (None if expected is None else pytest.approx(expected))
    assert any(line["return"] is not None for line in found)
