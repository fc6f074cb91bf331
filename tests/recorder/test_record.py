"""`record`: any script's run becomes a record, and none is lost, mixed or replaced."""

from __future__ import annotations

import copy
import gc
import pickle
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.error import ResetNeeded
from gymnasium.vector import SyncVectorEnv

import sprl_bench
from script_runs import ID, episodes, make, only_record, play, play_all
from sprl_bench import scores
from sprl_bench.records import RunRecord, read
from sprl_bench.records import folder as folders

pytestmark = pytest.mark.usefixtures("fakes")


def test_the_log_tells_what_has_been_written(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level("INFO", "sprl_bench"):
        for seed, steps in enumerate((100, 40)):
            env = sprl_bench.record(make(), out=tmp_path, agent="mine", seed=seed, budget=100)
            play(env, steps)
            env.close()
    folder = tmp_path / "custom" / "FourRooms-7x7-100" / "mine"
    assert [(record.levelname, record.getMessage()) for record in caplog.records] == [
        ("INFO", f"{folder}/seed-0 has its record: all of the 100 env steps."),
        ("WARNING", f"{folder}/seed-1 has an incomplete record, which no table takes: 40 of 100 env steps."),
    ]


def test_a_single_environment_is_recorded_at_its_budget(tmp_path: Path) -> None:
    env = sprl_bench.record(make(), out=tmp_path, agent="mine", seed=3, budget=400)
    play(env, 399)
    assert not list(tmp_path.rglob("record.json"))
    env.step(0)
    path = tmp_path / "custom" / "FourRooms-7x7-400" / "mine" / "seed-3" / "record.json"
    record = read(path, RunRecord)
    content = path.read_bytes()
    play(env, 300)
    env.close()
    assert path.read_bytes() == content

    assert record.status == "complete"
    assert (record.spec.agent, record.spec.seed, record.spec.num_envs, record.spec.source) == ("mine", 3, 1, "")
    table = episodes(tmp_path)
    assert list(table) == ["stamp", "env", "return", "length", "success"]
    assert record.totals.episodes == len(table["stamp"]) > 3
    assert record.totals.env_steps == 400
    assert record.return_curve == tuple(scores.curve(table["stamp"], table["return"], 400).tolist())
    assert record.success_curve == tuple(scores.curve(table["stamp"], table["success"], 400).tolist())
    assert {"python", "numpy", "gymnasium", "minigrid", "sprl-bench"} <= set(record.versions)
    assert sorted(path.name for path in path.parent.iterdir()) == ["episodes.parquet", "record.json"]


def test_the_recorder_changes_nothing(tmp_path: Path) -> None:
    env, plain = sprl_bench.record(make(), out=tmp_path, agent="mine", seed=0), make()
    assert isinstance(env, gymnasium.Env)
    assert (env.observation_space, env.action_space) == (plain.observation_space, plain.action_space)
    np.testing.assert_equal(env.reset(seed=5), plain.reset(seed=5))
    for action in np.random.default_rng(0).integers(7, size=40).tolist():
        result = env.step(action)
        np.testing.assert_equal(result, plain.step(action))
        if result[2] or result[3]:
            break


def test_all_ways_to_make_three_environments_give_the_same_curve(tmp_path: Path) -> None:
    """Our engine, Gymnasium's vector env, and three single ones in turn: one MDP, one score."""
    common: dict[str, Any] = {"agent": "mine", "seed": 0, "budget": 900}
    engine = sprl_bench.record(gymnasium.make_vec(ID, 3), out=tmp_path / "engine", **common)
    sync = SyncVectorEnv([make] * 3, autoreset_mode="SameStep")
    sync = sprl_bench.record(sync, out=tmp_path / "sync", **common)
    inside = [lambda: sprl_bench.record(make(), out=tmp_path / "inside", **common)] * 3
    for envs in (engine, sync, SyncVectorEnv(inside, autoreset_mode="SameStep")):
        play_all(envs, 300)
        envs.close()
    first = only_record(tmp_path / "engine")
    assert first.status == "complete"
    assert first.totals.episodes >= 6
    for way in ("sync", "inside"):
        other = only_record(tmp_path / way)
        assert other.return_curve == first.return_curve
        assert (other.totals, other.spec, other.fingerprint) == (first.totals, first.spec, first.fingerprint)
        assert episodes(tmp_path / way) == episodes(tmp_path / "engine")


def test_environments_that_reset_by_themselves_a_step_later_are_in_turn(tmp_path: Path) -> None:
    def inside() -> gymnasium.Env[Any, Any]:
        return sprl_bench.record(make(), out=tmp_path / "inside", agent="mine", seed=0, budget=900)

    engine = gymnasium.make_vec(ID, 3, autoreset_mode="NextStep")
    engine = sprl_bench.record(engine, out=tmp_path / "engine", agent="mine", seed=0, budget=900)
    for envs in (engine, SyncVectorEnv([inside] * 3, autoreset_mode="NextStep")):
        play_all(envs, 310)
    assert only_record(tmp_path / "inside").status == "complete"
    assert episodes(tmp_path / "inside") == episodes(tmp_path / "engine")


def test_a_record_says_what_torch_computed_with(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    torch = SimpleNamespace(
        get_num_threads=lambda: 3,
        cuda=SimpleNamespace(is_initialized=lambda: True, get_device_name=lambda: "made up"),
    )
    monkeypatch.setitem(sys.modules, "torch", torch)
    play(sprl_bench.record(make(), out=tmp_path, agent="mine", seed=0, budget=50), 50)
    spec = only_record(tmp_path).spec
    assert (spec.device, spec.torch_threads) == ("cuda", 3)


def test_numbers_may_be_numpys(tmp_path: Path) -> None:
    env = gymnasium.make("SPRL/FetchReachSparse-v1", substep=np.int64(5), action_noise=np.float32(0.5))
    recorded = sprl_bench.record(env, out=tmp_path, agent="mine", seed=np.int64(2), budget=np.int64(3))
    recorded.reset(seed=2)  # some other goals lie within reach of three steps
    for _ in range(3):
        recorded.step(np.zeros(4))
    spec = only_record(tmp_path).spec
    assert (spec.seed, spec.task.budget, spec.task.arguments) == (2, 3, {"substep": 5, "action_noise": 0.5})


def test_a_range_of_scores_goes_with_a_task_of_no_suite(tmp_path: Path) -> None:
    env = gymnasium.make("CartPole-v1")
    env = sprl_bench.record(env, out=tmp_path, agent="mine", seed=0, budget=60, score_range=(0, 500))
    env.reset(seed=0)
    for _ in range(60):
        if any(env.step(0)[2:4]):
            env.reset()
    record = only_record(tmp_path)
    assert record.spec.task.score_range == (0.0, 500.0)
    assert record.scores.steps_to_threshold is None
    assert sprl_bench.record(make(), out=tmp_path, agent="other", seed=0, score_range=[0, 1])  # type: ignore[arg-type]
    with pytest.raises(ValueError, match=r"score_range is \(0, 2\); it must be that of FourRooms-7x7, \(0\.0, 1\.0\)"):
        sprl_bench.record(make(), out=tmp_path, agent="mine", seed=0, score_range=(0, 2))


def test_two_ways_to_one_folder_are_one(tmp_path: Path) -> None:
    ways = (tmp_path / "runs", tmp_path / "runs" / ".." / "runs")
    envs = [sprl_bench.record(make(), out=way, agent="mine", seed=0, budget=400) for way in ways]
    for env in envs:
        env.reset()
    for env in envs * 200:
        if any(env.step(0)[2:4]):
            env.reset()
    assert only_record(tmp_path).spec.num_envs == 2


def test_an_environment_that_is_closed_before_the_others_fails_in_its_episode(tmp_path: Path) -> None:
    first, second = (sprl_bench.record(make(), out=tmp_path, agent="mine", seed=0, budget=400) for _ in range(2))
    for env in (first, second):
        env.reset(seed=0)
    for env in (first, second) * 3:
        env.step(0)
    first.close()
    play(second, 394, seed=None)
    record = only_record(tmp_path)
    assert (record.status, record.spec.num_envs) == ("complete", 2)
    assert [column[0] for column in (episodes(tmp_path)[name] for name in ("stamp", "env", "length", "success"))] == [
        5, 0, 3, False,
    ]  # fmt: skip


def test_a_seed_goes_with_the_first_reset_alone(tmp_path: Path) -> None:
    """Else a script that seeds each reset would be scored on one layout."""
    env = sprl_bench.record(make(), out=tmp_path, agent="mine", seed=0, budget=400)
    env.reset(seed=3)
    env.reset(seed=7)
    env.step(0)
    with pytest.raises(ValueError, match=r"^seed is 7, but recorded steps have been taken"):
        env.reset(seed=7)
    play(env, 399, seed=None)
    env.reset(seed=7)
    assert only_record(tmp_path).status == "complete"


@pytest.mark.parametrize("seed", [5, [None, 5]])
def test_no_sub_environment_is_seeded_again(tmp_path: Path, seed: Any) -> None:
    envs = sprl_bench.record(gymnasium.make_vec(ID, 2), out=tmp_path, agent="mine", seed=0, budget=400)
    envs.reset(seed=seed)
    envs.step(np.zeros(2, np.int64))
    envs.reset(seed=[None, None])
    with pytest.raises(ValueError, match="recorded steps have been taken"):
        envs.reset(seed=seed)


def test_a_reset_of_some_does_not_begin_the_others(tmp_path: Path) -> None:
    envs = gymnasium.make_vec(ID, 2, autoreset_mode="Disabled")
    envs.reset(seed=0)
    envs.step(np.zeros(2, np.int64))
    recorded = sprl_bench.record(envs, out=tmp_path, agent="mine", seed=0, budget=400)
    for mask in ([True, False], [False, True]):
        with pytest.raises(ResetNeeded, match="in part"):
            recorded.step(np.zeros(2, np.int64))
        recorded.reset(options={"reset_mask": np.array(mask)})
    recorded.step(np.zeros(2, np.int64))


@pytest.mark.parametrize("vector", [False, True])
def test_recording_begins_with_a_reset(tmp_path: Path, vector: bool) -> None:
    env: Any = gymnasium.make_vec(ID, 2) if vector else make()
    env.reset(seed=0)
    env.step(env.action_space.sample())
    recorded = sprl_bench.record(env, out=tmp_path, agent="mine", seed=0, budget=400)
    with pytest.raises(ResetNeeded, match=r"must be reset\(\) before its first step"):
        recorded.step(env.action_space.sample())
    recorded.reset()
    recorded.step(env.action_space.sample())


def test_a_time_limit_above_is_scored_as_failure(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    env = sprl_bench.record(make(), out=tmp_path, agent="mine", seed=0, budget=1000)
    play(gymnasium.wrappers.TimeLimit(env, 10), 1000)
    record = only_record(tmp_path)
    assert 90 < record.totals.abandoned == record.totals.episodes - record.totals.successes
    assert f"{record.totals.abandoned} of {record.totals.episodes} episodes were reset before" in caplog.text


def test_closing_early_leaves_an_incomplete_record(tmp_path: Path) -> None:
    env = sprl_bench.record(make(), out=tmp_path, agent="mine", seed=0)
    play(env, 250)
    env.close()
    env.close()
    record = only_record(tmp_path)
    assert (record.status, record.totals.env_steps) == ("incomplete", 250)
    assert record.spec.suite == "grid"


def test_a_forgotten_environment_leaves_an_incomplete_record(tmp_path: Path) -> None:
    play(sprl_bench.record(make(), out=tmp_path, agent="mine", seed=0), 10)
    gc.collect()
    assert only_record(tmp_path).totals.env_steps == 10


@pytest.mark.parametrize("end", ["", "raise ZeroDivisionError"])
def test_the_end_of_the_process_leaves_an_incomplete_record(tmp_path: Path, end: str) -> None:
    script = f"""
import sys, gymnasium, sprl_bench
env = sprl_bench.record(gymnasium.make("{ID}"), out=r"{tmp_path}", agent="mine", seed=0)
env.reset(seed=0)
for _ in range(120): env.step(0) if _ != 100 else env.reset()
{end}
"""
    subprocess.run([sys.executable, "-W", "error", "-c", script], check=not end, timeout=120, capture_output=True)
    record = only_record(tmp_path)
    assert (record.status, record.totals.env_steps, record.totals.episodes) == ("incomplete", 119, 1)


def test_an_incomplete_record_may_be_replaced_and_a_complete_one_not(tmp_path: Path) -> None:
    common: dict[str, Any] = {"out": tmp_path, "agent": "mine", "seed": 0, "budget": 100}
    env = sprl_bench.record(make(), **common)
    play(env, 50)
    env.close()
    env = sprl_bench.record(make(), **common)
    play(env, 100)
    with pytest.raises(FileExistsError, match="holds a complete record; use another seed, agent or out"):
        sprl_bench.record(make(), **common)
    env.close()
    assert only_record(tmp_path).totals.env_steps == 100


def test_an_environment_that_took_no_step_leaves_nothing(tmp_path: Path) -> None:
    env = sprl_bench.record(make(), out=tmp_path, agent="mine", seed=0)
    env.reset()
    env.close()
    assert not [path for path in tmp_path.rglob("*") if path.is_file()]


def test_another_process_that_records_the_same_run_is_noticed(tmp_path: Path) -> None:
    script = f"""
import gymnasium, sprl_bench
sprl_bench.record(gymnasium.make("{ID}"), out=r"{tmp_path}", agent="mine", seed=0)
"""
    env = sprl_bench.record(make(), out=tmp_path, agent="mine", seed=0)
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 1
    assert "is in use by another process (process" in done.stderr
    env.close()


def test_an_unfinished_run_of_the_command_line_is_left_alone(tmp_path: Path) -> None:
    place = tmp_path / "grid" / "FourRooms-7x7" / "ppo" / "seed-0"
    place.mkdir(parents=True)
    (place / folders.CHECKPOINT).touch()
    with pytest.raises(FileExistsError, match="an unfinished run of the command line"):
        sprl_bench.record(make(), out=tmp_path, agent="ppo", seed=0)
    assert [path.name for path in place.iterdir()] == [folders.CHECKPOINT]


def test_what_is_recorded_cannot_be_recorded_again(tmp_path: Path) -> None:
    env = sprl_bench.record(make(), out=tmp_path, agent="mine", seed=0)
    with pytest.raises(ValueError, match="EnvRecorder lies beneath the recorder"):
        sprl_bench.record(env, out=tmp_path, agent="mine", seed=1)
    envs = sprl_bench.record(gymnasium.make_vec(ID, 2), out=tmp_path, agent="other", seed=0)
    with pytest.raises(ValueError, match="VectorRecorder lies beneath the recorder"):
        sprl_bench.record(envs, out=tmp_path, agent="other", seed=1)
    with pytest.raises(ValueError, match="being recorded already"):
        sprl_bench.record(gymnasium.make_vec(ID, 2), out=tmp_path, agent="other", seed=0)


def test_what_is_recorded_is_not_copied(tmp_path: Path) -> None:
    common: dict[str, Any] = {"out": tmp_path, "agent": "mine"}
    recorded = [
        sprl_bench.record(make(), seed=0, **common),
        sprl_bench.record(gymnasium.make_vec(ID, 2), seed=1, **common),
    ]
    for env in recorded:
        for copying in (copy.deepcopy, pickle.dumps):
            with pytest.raises(
                TypeError, match="cannot be copied or pickled; record each environment where it is used"
            ):
                copying(env)
        copy.deepcopy(env.unwrapped)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"seed": -1}, "seed: "),
        ({"seed": True}, "seed: "),
        ({"seed": "0"}, "seed: "),
        ({"agent": "a/b"}, "agent: 'a/b' cannot name a folder"),
        ({"agent": ""}, "agent: "),
        ({"suite": "smok"}, "Unknown suite 'smok'; did you mean 'smoke'"),
        ({"budget": -5}, "budget is -5"),
        ({"hyperparameters": {"f": print}}, "hyperparameters: f is <built-in function print> .*; it must be plain"),
        ({"hyperparameters": {1: 2}}, "hyperparameters: the name 1 is not text"),
        (
            {"hyperparameters": {"f": np.zeros(500)}},
            r"hyperparameters: f is array.* \(numpy.ndarray\); it must be plain",
        ),
        ({"hyperparameters": {"f": [float("nan")]}}, r"hyperparameters: f is \[nan\]; it must be plain"),
    ],
)
def test_bad_arguments_are_named_in_one_line(tmp_path: Path, changes: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message) as raised:
        sprl_bench.record(make(), **{"out": tmp_path, "agent": "mine", "seed": 0, **changes})
    assert "\n" not in str(raised.value)
    assert not list(tmp_path.iterdir())


def test_hyperparameters_and_privileges_are_noted(tmp_path: Path) -> None:
    env = sprl_bench.record(
        make(), out=tmp_path, agent="mine", seed=0, budget=5, privileged=True, hyperparameters={"widths": (3, 4)}
    )
    play(env, 5)
    record = only_record(tmp_path)
    assert record.spec.privileged
    assert record.spec.hyperparameters == {"widths": [3, 4]}


def test_an_environment_of_no_suite_is_recorded_with_a_budget(tmp_path: Path) -> None:
    env = sprl_bench.record(gymnasium.make("CartPole-v1"), out=tmp_path, agent="mine", seed=0, budget=60)
    env.reset(seed=0)
    for _ in range(60):
        *_, terminated, truncated, _ = env.step(1)
        if terminated or truncated:
            env.reset()
    record = only_record(tmp_path)
    assert record.spec.path(tmp_path) == tmp_path / "custom" / "CartPole-v1-60" / "mine" / "seed-0"
    assert record.totals.successes == 0
    assert record.totals.mean_return == record.totals.mean_length > 5


def test_what_cannot_be_written_leaves_nothing_half(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    env = sprl_bench.record(make(), out=tmp_path, agent="mine", seed=0, budget=10)
    play(env, 9)

    def full(_: int) -> None:
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr("os.fsync", full)
        env.step(0)  # the log says that the record is not written yet
        with pytest.raises(OSError, match="No space left"):
            env.close()
    assert [path.name for path in tmp_path.rglob("*") if path.is_file()] == [".lock"]
    env.close()
    assert only_record(tmp_path).status == "complete"
