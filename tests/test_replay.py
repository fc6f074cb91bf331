"""A run repeated by its kept actions has the same episodes, curves and scores, and a forged one has not."""

from __future__ import annotations

import json
import tracemalloc
from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium import spaces
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from pyarrow import parquet

import sprl_bench
from cli_calls import Capture, call
from sprl_bench.leaderboard import read_entry
from sprl_bench.recorder.tape import Head, Steps, Tape, UnfitForTapeError, read_tape
from sprl_bench.records import RunSpec
from sprl_bench.records.folder import ACTIONS, CHECKPOINT, EPISODES, RECORD
from sprl_bench.replay import NotReplayableError, retrain, verify, verify_entry
from sprl_bench.run import InterruptedRunError, run
from sprl_bench.suite import expand
from sprl_bench.tasks import find_suite

GRID = "sprl_bench:SPRL/FourRooms-7x7-v1"


def spec_of(agent: str = "ppo", task: str = "FourRooms-7x7", suite: str = "grid-7x7", **keywords: Any) -> RunSpec:
    settings = {"budget": 2_000, **keywords}
    [spec] = expand(find_suite(suite), [agent], [0], tasks=[task], device="cpu", **settings)
    return spec


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("finished")
    spec = spec_of()
    run(spec, root, keep_actions=True)
    return spec.path(root)


@pytest.fixture
def kept(finished: Path, tmp_path: Path) -> Path:
    """A copy of the finished run, to be forged."""
    for path in finished.iterdir():
        (tmp_path / path.name).write_bytes(path.read_bytes())
    return tmp_path


# --------------------------------------------------------------------------- the tape


@given(number=st.integers(1, 300), seed=st.integers(0, 99), shape=st.tuples(st.integers(1, 20), st.integers(1, 5)))
def test_discrete_actions_are_packed_without_loss(number: int, seed: int, shape: tuple[int, int]) -> None:
    head = Head.of(spaces.Discrete(number), shape[1])
    actions = np.random.default_rng(seed).integers(number, size=shape)
    packed = head.pack(actions)
    assert head.unpack(packed).tolist() == actions.reshape(-1).tolist()
    assert len(packed) <= 8 + (actions.size * max(1, (number - 1).bit_length()) + 7) // 8


@given(actions=hnp.arrays(np.float32, st.tuples(st.integers(1, 20), st.just(4)), elements=st.floats(-1, 1, width=32)))
def test_continuous_actions_are_packed_without_loss(actions: np.ndarray) -> None:
    head = Head.of(spaces.Box(-1, 1, (4,)))
    assert head.unpack(head.pack(actions)).tobytes() == actions.tobytes()


@pytest.mark.parametrize("space", [spaces.MultiDiscrete([2, 2]), spaces.Discrete(3, start=1), spaces.Dict()])
def test_other_action_spaces_are_refused(space: spaces.Space[Any]) -> None:
    with pytest.raises(UnfitForTapeError, match=r"^action_space is .*; it must be Discrete from 0 or a Box"):
        Head.of(space)


def test_an_action_outside_of_the_space_is_refused() -> None:
    with pytest.raises(UnfitForTapeError, match="outside of 0 to 6"):
        Head.of(spaces.Discrete(7)).pack(np.array([3, 7]))


def test_events_come_back_in_their_order(tmp_path: Path) -> None:
    path = tmp_path / "tape"
    head = Head(num_envs=2, autoreset="SameStep", discrete=7)
    with path.open("w+b") as file:
        tape = Tape(file, head)
        tape.reset(None)
        for step in range(5_000):
            tape.step(np.array([step % 7, 6]))
        tape.reset(None, np.array([True, False]))
        tape.step(np.array([1, 2]))
        tape.flush()
    found, events = read_tape(path)
    first, *steps, reset, last = events
    assert (found, first) == (head, (-1, None, None))
    assert reset == (-1, None, [True, False])
    assert all(isinstance(one, Steps) for one in (*steps, last))
    assert np.concatenate([one.actions for one in steps])[:, 0].tolist() == [step % 7 for step in range(5_000)]
    assert last.actions.tolist() == [[1, 2]]


# --------------------------------------------------------------------------- runs of the harness


@pytest.mark.parametrize(
    ("agent", "suite", "task"),
    [
        ("random", "grid-7x7", "KeyDoors-7x7"),
        ("sprl", "grid-7x7", "FourRooms-7x7"),
        ("ppo", "fetch-sparse", "FetchPickAndPlace-substep10"),
        ("ppo", "noise", "FetchReach-substep2-noise0.1"),
    ],
)
def test_a_run_is_replayed_equal(agent: str, suite: str, task: str, tmp_path: Path) -> None:
    if "etch" in suite + task:
        pytest.importorskip("mujoco")
    spec = spec_of(agent, task, suite)
    record = run(spec, tmp_path, keep_actions=True)
    found = verify(spec.path(tmp_path))
    assert found.equal, found.difference
    assert found.env_steps >= record.totals.env_steps == 2_000


def test_keeping_actions_changes_nothing_else(finished: Path, tmp_path: Path) -> None:
    record = run(spec_of(), tmp_path)
    folder = spec_of().path(tmp_path)
    assert not (folder / ACTIONS).exists()
    assert (folder / EPISODES).read_bytes() == (finished / EPISODES).read_bytes()
    assert record.return_curve == verify(finished).record.return_curve


def test_an_interrupted_run_keeps_the_same_tape(finished: Path, tmp_path: Path) -> None:
    spec, stops = spec_of(), iter([True, *[False] * 99])
    with pytest.raises(InterruptedRunError):
        run(spec, tmp_path, keep_actions=True, stop=lambda: next(stops))
    folder = spec.path(tmp_path)
    with (folder / ACTIONS).open("ab") as file:
        file.write(b"steps after the checkpoint" * 1_000)
    run(spec, tmp_path)  # it goes on as it began
    assert (folder / ACTIONS).read_bytes() == (finished / ACTIONS).read_bytes()
    assert verify(folder).equal


def test_actions_are_not_kept_from_the_middle(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    spec, stops = spec_of(), iter([True, *[False] * 99])
    with pytest.raises(InterruptedRunError):
        run(spec, tmp_path, stop=lambda: next(stops))
    run(spec, tmp_path, keep_actions=True)
    assert "keeps no actions: it was begun without" in caplog.text
    with pytest.raises(NotReplayableError, match=f"has no {ACTIONS}; the run must be made with --keep-actions"):
        verify(spec.path(tmp_path))
    assert not (spec.path(tmp_path) / CHECKPOINT).exists()


# --------------------------------------------------------------------------- forgeries


def forge_record(folder: Path, change: Callable[[dict[str, Any]], None]) -> None:
    record = json.loads((folder / RECORD).read_text())
    change(record)
    (folder / RECORD).write_text(json.dumps(record))


def test_a_forged_total_is_found(kept: Path) -> None:
    forge_record(kept, lambda record: record["totals"].update(mean_length=1.5))
    assert verify(kept).difference == "totals of the record does not follow from the replayed episodes"


def test_a_forged_curve_is_found(kept: Path) -> None:
    def raise_all(record: dict[str, Any]) -> None:
        record["return_curve"] = [1.0] * 100
        record["scores"].update(auc=1.0, final=1.0, steps_to_threshold=20)

    forge_record(kept, raise_all)
    assert verify(kept).difference.startswith("return_curve of the record")


def test_a_forged_episode_is_found_with_its_step(kept: Path) -> None:
    table = parquet.read_table(kept / EPISODES)
    returns = table.column("return").to_pylist()
    place = len(returns) // 2
    returns[place] = 0.75
    forged = table.set_column(table.schema.get_field_index("return"), "return", [returns])
    parquet.write_table(forged, kept / EPISODES)
    stamp = table.column("stamp")[place].as_py()
    assert verify(kept).difference.startswith(f"episode {place}, which ends at env step {stamp}, has the return 0.75")


def test_another_seed_is_found(kept: Path) -> None:
    forge_record(kept, lambda record: record["spec"].update(seed=1))
    assert "in the replay" in verify(kept).difference


@pytest.mark.parametrize("lost", [1, 5, 100])
def test_a_tape_that_is_cut_is_refused(kept: Path, lost: int) -> None:
    content = (kept / ACTIONS).read_bytes()
    (kept / ACTIONS).write_bytes(content[:-lost])
    with pytest.raises(NotReplayableError, match=rf"{ACTIONS} has a broken block, \d+ bytes before its end"):
        verify(kept)


def test_another_file_is_refused(kept: Path) -> None:
    (kept / ACTIONS).write_bytes(b"\x00" * 50)
    with pytest.raises(NotReplayableError, match="does not begin like a tape of actions"):
        verify(kept)


def test_a_tape_without_its_last_block_gives_another_run(kept: Path) -> None:
    content = (kept / ACTIONS).read_bytes()
    head, _ = read_tape(kept / ACTIONS)
    for cut in range(len(content) - 1, 0, -1):
        (kept / ACTIONS).write_bytes(content[:cut])
        try:
            list(read_tape(kept / ACTIONS)[1])
            break
        except UnfitForTapeError:
            continue
    assert verify(kept).difference
    assert head.discrete == 7


def steps_block(folder: Path, count: int) -> bytes:
    """Return a block of `count` further steps for the tape of a run."""
    path, head = folder / "more", read_tape(folder / ACTIONS)[0]
    with path.open("w+b") as file:
        tape = Tape(file, head)
        begin = tape.flush()
        for _ in range(count):
            tape.step(np.zeros(head.num_envs, np.int64))
        tape.flush()
    return path.read_bytes()[begin:]


@pytest.mark.parametrize("count", [1, 300])
def test_a_tape_with_more_steps_than_the_record_is_refused(count: int, kept: Path) -> None:
    with (kept / ACTIONS).open("ab") as file:
        file.write(steps_block(kept, count))
    with pytest.raises(NotReplayableError, match=r"^The tape goes on after 2,\d+ env steps; it must end at 2,000\.$"):
        verify(kept)


def test_of_a_tape_only_as_much_as_a_head_is_read_first(tmp_path: Path) -> None:
    path = tmp_path / "tape"
    with path.open("wb") as file:
        file.truncate(2**27)  # one line without an end
    tracemalloc.start()
    with pytest.raises(UnfitForTapeError, match=r"its head has more than 65,536 bytes\.$"):
        read_tape(path)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 2**21


def test_a_tape_is_read_block_by_block(tmp_path: Path) -> None:
    path = tmp_path / "tape"
    with path.open("w+b") as file:
        tape = Tape(file, Head(num_envs=0, autoreset="", discrete=0, shape=(4_096,), dtype="float64"))
        for seed in range(64):
            tape.step(np.random.default_rng(seed).random(4_096), env=0)
            tape.flush()
    tracemalloc.start()
    assert sum(len(one.actions) for one in read_tape(path)[1] if isinstance(one, Steps)) == 64
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < path.stat().st_size / 4


def test_a_tape_cannot_expand_without_limit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "tape"
    with path.open("w+b") as file:
        tape = Tape(file, Head(num_envs=1, autoreset="SameStep", discrete=2))
        for _ in range(4_000):
            tape.step(np.array([0]))
        tape.flush()
    monkeypatch.setattr("sprl_bench.recorder.tape.LARGEST", 100)
    with pytest.raises(UnfitForTapeError, match="a block is cut off or too large"):
        list(read_tape(path)[1])


# --------------------------------------------------------------------------- runs of scripts


def only_folder(root: Path) -> Path:
    [record] = root.rglob(RECORD)
    return record.parent


def test_a_script_with_single_environments_is_replayed(tmp_path: Path) -> None:
    about = {"out": tmp_path, "agent": "mine", "seed": 0, "budget": 900, "keep_actions": True}
    envs = [sprl_bench.record(gymnasium.make(GRID), **about) for _ in range(3)]
    generator = np.random.default_rng(0)
    for number, env in enumerate(envs):
        env.reset(seed=number)
    for step in range(300):
        for env in envs:
            _, _, terminated, truncated, _ = env.step(int(generator.integers(3)))
            if terminated or truncated or step == 50:
                env.reset()
    found = verify(only_folder(tmp_path))
    assert found.equal, found.difference
    assert found.record.totals.abandoned == 3


def test_an_environment_that_is_closed_early_is_replayed(tmp_path: Path) -> None:
    about = {"out": tmp_path, "agent": "mine", "seed": 0, "budget": 300, "keep_actions": True}
    first, second = (sprl_bench.record(gymnasium.make(GRID), **about) for _ in range(2))
    for number, env in enumerate((first, second)):
        env.reset(seed=number)
    for _ in range(30):
        first.step(0)
        second.step(1)
    first.close()
    for _ in range(300):
        _, _, terminated, truncated, _ = second.step(1)
        if terminated or truncated:
            second.reset()
    assert verify(only_folder(tmp_path)).equal


@pytest.mark.parametrize("mode", ["SameStep", "NextStep"])
def test_a_script_with_a_vector_environment_is_replayed(mode: str, tmp_path: Path) -> None:
    envs = gymnasium.make_vec(GRID, num_envs=4, autoreset_mode=mode)
    envs = sprl_bench.record(envs, out=tmp_path, agent="mine", seed=0, budget=1_000, keep_actions=True)
    envs.reset(seed=7)
    envs.action_space.seed(0)
    for step in range(300):
        envs.step(envs.action_space.sample())
        if step == 30:
            envs.reset()
    found = verify(only_folder(tmp_path))
    assert found.equal, found.difference


@pytest.mark.parametrize("env_id", [GRID, "SPRL/FetchReachSparse-v1", "SPRL/MazeGoalSmall-v1", "CartPole-v1"])
@pytest.mark.parametrize("vector", [True, False])
def test_a_script_that_gives_no_seed_is_replayed_by_the_one_that_was_drawn(
    vector: bool, env_id: str, tmp_path: Path
) -> None:
    make: Any = gymnasium.make_vec if vector else gymnasium.make
    arguments: dict[str, Any] = {"num_envs": 2} if vector else {}
    if vector and env_id == "CartPole-v1":
        arguments |= {"vectorization_mode": "sync", "vector_kwargs": {"autoreset_mode": "SameStep"}}
    env = sprl_bench.record(
        make(env_id, **arguments), out=tmp_path, agent="mine", seed=0, budget=500, keep_actions=True
    )
    env.reset()
    env.action_space.seed(0)
    while not env.episode_log.complete:
        ended = np.any(np.logical_or(*env.step(env.action_space.sample())[2:4]))
        if ended and not vector:
            env.reset()
    env.close()
    assert verify(only_folder(tmp_path)).equal


@pytest.mark.parametrize("vector", [True, False])
def test_an_environment_that_was_reset_before_is_not_replayed_as_if_it_were_new(vector: bool, tmp_path: Path) -> None:
    env: Any = gymnasium.make_vec(GRID, num_envs=2) if vector else gymnasium.make(GRID)
    env.reset(seed=5)
    env = sprl_bench.record(env, out=tmp_path, agent="mine", seed=0, budget=500, keep_actions=True)
    env.reset()
    env.action_space.seed(0)
    while not env.episode_log.complete:
        if np.any(np.logical_or(*env.step(env.action_space.sample())[2:4])) and not vector:
            env.reset()
    env.close()
    with pytest.raises(NotReplayableError, match="The first reset on the tape has no seed"):
        verify(only_folder(tmp_path))


def test_a_generator_from_outside_is_not_taken_for_a_seed_that_was_drawn(tmp_path: Path) -> None:
    """Tianshou's factories set one on each environment; it has no seed that could be noted."""
    env: Any = gymnasium.make(GRID)
    env = sprl_bench.record(env, out=tmp_path, agent="mine", seed=0, budget=500, keep_actions=True)
    env.np_random = np.random.default_rng(5)
    env.reset()
    env.action_space.seed(0)
    while not env.episode_log.complete:
        if any(env.step(env.action_space.sample())[2:4]):
            env.reset()
    env.close()
    with pytest.raises(NotReplayableError, match="The first reset on the tape has no seed"):
        verify(only_folder(tmp_path))


def test_a_tape_cannot_ask_for_environments_without_limit(kept: Path) -> None:
    with (kept / ACTIONS).open("w+b") as file:
        tape = Tape(file, Head(num_envs=0, autoreset="", discrete=7))
        tape.reset(None, env=10**9)
    with pytest.raises(NotReplayableError, match="has an environment of index 1000000000; it must be below 4096"):
        verify(kept)


# --------------------------------------------------------------------------- the command


def test_the_command_says_what_is_equal_and_what_is_not(capsys: Capture, kept: Path, finished: Path) -> None:
    status, printed, _ = call(capsys, "verify", finished)
    assert status == 0
    assert "env steps replayed; equal" in printed
    forge_record(kept, lambda record: record["totals"].update(mean_length=1.5))
    status, printed, _ = call(capsys, "verify", finished, kept)
    assert status == 1
    assert "DIFFERENT: totals of the record" in printed
    assert "1 of 2 runs are replayed equal." in printed
    (kept / ACTIONS).unlink()
    assert call(capsys, "verify", kept)[0] == 1


def test_a_folder_without_runs_is_refused(capsys: Capture, tmp_path: Path) -> None:
    status, _, err = call(capsys, "verify", tmp_path)
    assert status == 1
    assert err.strip() == f"sprl-bench: {tmp_path} has no finished run."


# --------------------------------------------------------------------------- entries


@pytest.fixture(scope="module")
def published(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """An entry of five seeds, and the folder of its runs."""
    runs, home = tmp_path_factory.mktemp("runs"), tmp_path_factory.mktemp("boards")
    specs = expand(find_suite("smoke"), ["random"], range(5), device="cpu")
    records = [run(spec, runs, keep_actions=True) for spec in specs]
    entry = sprl_bench.make_entry(records, agent="random", authors=["A. Author"], link="https://example.org/x")
    return sprl_bench.add_entry(entry, home), runs


def test_an_entry_is_replayed_and_marked(capsys: Capture, published: tuple[Path, Path]) -> None:
    path, runs = published
    before = json.loads(path.read_text())
    assert before["evidence"] == "recorded"
    status, printed, err = call(capsys, "verify", path, "--runs", runs, "--mark")
    assert (status, printed.splitlines()[-1]) == (0, "5 of 5 runs are replayed equal.")
    assert err.strip() == f"Wrote {path}: its evidence is replayed."
    assert json.loads(path.read_text()) == {**before, "evidence": "replayed"}
    shown = call(capsys, "leaderboard", "show", "--home", path.parent.parent)[1]
    assert "random: reported, replayed; A. Author" in shown


def test_an_entry_with_the_curves_of_other_runs_is_found(published: tuple[Path, Path]) -> None:
    path, runs = published
    entry = read_entry(path)
    [part] = entry.tasks
    first, second, *rest = part.results
    swapped = [second.model_copy(update={"seed": 0}), first.model_copy(update={"seed": 1}), *rest]
    forged = entry.model_copy(update={"tasks": (part.model_copy(update={"results": tuple(swapped)}),)})
    found = [one.difference for one in verify_entry(forged, runs)]
    assert found == ["return_curve of the entry is not that of the record"] * 2 + [""] * 3


def test_a_row_is_trained_again_from_its_entry_alone(
    capsys: Capture, published: tuple[Path, Path], tmp_path: Path
) -> None:
    command = ["reproduce-row", published[0], "--task", "FourRooms-7x7", "--out", tmp_path]
    status, printed, _ = call(capsys, *command, "--seed", "3")
    assert status == 0
    assert printed.strip().endswith("every curve and score is the entry's.")
    status, _, err = call(capsys, *command, "--seed", "9")
    assert (status, err.strip()) == (2, "sprl-bench: seed is 9; it must be one of this entry's: 0, 1, 2, 3, 4.")


def test_a_row_that_comes_out_otherwise_is_told(published: tuple[Path, Path], tmp_path: Path) -> None:
    entry = read_entry(published[0])
    [part] = entry.tasks
    other = part.results[1].model_copy(update={"seed": 0})
    forged = entry.model_copy(update={"tasks": (part.model_copy(update={"results": (other, *part.results[1:])}),)})
    _, difference = retrain(forged, "FourRooms-7x7", 0, tmp_path)
    assert difference == "return_curve of the entry is not that of the record"
