"""What strangers do with the product: each habit works, or is refused in a sentence that says what to do."""

from __future__ import annotations

import importlib
import json
import logging
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import gymnasium
import numpy as np
import pytest

import sprl_bench
from cli_calls import Capture, call, refused
from script_runs import make, only_record, play
from sprl_bench import checkpoint, leaderboard, provenance, records
from sprl_bench.extras import EXTRAS, advice
from sprl_bench.numba_cache import OptionalCache, compile_cached
from sprl_bench.records import InvalidFileError, RunRecord, RunSpec, find_records
from sprl_bench.records.folder import CHECKPOINT, RECORD, SPEC, WEIGHTS
from sprl_bench.resume import CheckpointRefusedError
from sprl_bench.run import InterruptedRunError, run
from sprl_bench.suggestions import did_you_mean
from sprl_bench.suite import expand
from sprl_bench.tasks import find_suite

MakeRecord = Callable[..., RunRecord]


def spec_of(agent: str, seed: int = 0, budget: int = 3_000) -> RunSpec:
    [spec] = expand(find_suite("smoke"), [agent], [seed], budget=budget)
    return spec


# --------------------------------------------------------------------------- scripts and notebooks


def test_a_cell_that_is_run_twice_is_told_what_is_still_open(tmp_path: Path) -> None:
    first = sprl_bench.record(make(), out=tmp_path, agent="mine", seed=0)
    play(first, 10)
    with pytest.raises(ValueError, match=r"returned earlier in this process is still open.*close\(\) it"):
        sprl_bench.record(make(), out=tmp_path, agent="mine", seed=0)
    first.close()
    again = sprl_bench.record(make(), out=tmp_path, agent="mine", seed=0)
    play(again, 20)
    again.close()
    assert only_record(tmp_path).totals.env_steps == 20


def test_a_collector_of_episodes_is_refused_at_its_first_uneven_step(tmp_path: Path) -> None:
    envs = [sprl_bench.record(make(), out=tmp_path, agent="mine", seed=0) for _ in range(3)]
    for env in envs:
        env.reset()
    for env in envs:
        env.step(0)
    envs[0].step(0)  # the next round may begin with any of them
    with pytest.raises(RuntimeError, match=r"not stepped in turn .* collect steps, or use gymnasium.make_vec"):
        envs[0].step(0)
    for env in envs:
        env.close()


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        ({"desc": ["SF", "FG"]}, "desc is ['SF', 'FG']"),
        ({"map_name": 2**60}, "map_name is 1152921504606846976"),
        ({"success_rate": float("nan")}, "success_rate is nan"),
    ],
)
def test_an_argument_that_no_record_can_hold_is_named(arguments: dict[str, Any], named: str, tmp_path: Path) -> None:
    env = gymnasium.make("FrozenLake-v1", is_slippery=False)
    assert env.unwrapped.spec is not None
    env.unwrapped.spec.kwargs.update(arguments)
    with pytest.raises(ValueError, match="in a record it must be text, a boolean or a finite number") as error:
        sprl_bench.record(env, out=tmp_path, agent="mine", seed=0, budget=100)
    assert str(error.value).startswith(named)
    env.close()


@pytest.mark.parametrize("arguments", [{"desc": None}, {"map_name": "4x4"}, {"desc": None, "is_slippery": True}])
def test_a_default_that_is_given_changes_no_task(arguments: dict[str, Any], tmp_path: Path) -> None:
    env = gymnasium.make("FrozenLake-v1", **arguments)
    env = sprl_bench.record(env, out=tmp_path, agent="mine", seed=0, budget=50)
    play_anything(env, 60)
    assert only_record(tmp_path).spec.task.arguments == {}
    env.close()


def play_anything(env: gymnasium.Env[Any, Any], steps: int) -> None:
    env.reset(seed=0)
    for _ in range(steps):
        *_, terminated, truncated, _ = env.step(env.action_space.sample())
        if terminated or truncated:
            env.reset()


def test_numpy_scalars_are_hyperparameters(tmp_path: Path) -> None:
    given = {"a": np.float32(0.5), "b": np.int64(3), "c": np.bool_(True), "d": [np.float64(1.5), {"e": np.uint8(2)}]}
    env = sprl_bench.record(make(), out=tmp_path, agent="mine", seed=0, hyperparameters=given)
    play(env, 5)
    env.close()
    assert only_record(tmp_path).spec.hyperparameters == {"a": 0.5, "b": 3, "c": True, "d": [1.5, {"e": 2}]}


class DictConfig(dict[str, Any]):
    """Looks like a plain dict, as containers of configuration libraries do, and holds what JSON does not."""


@pytest.mark.parametrize(
    ("value", "named"),
    [
        (np.ones(2), "x is array([1., 1.]) (numpy.ndarray)"),
        ({"inner": {1, 2}}, "x is {'inner': {1, 2}}, which holds {1, 2} (builtins.set)"),
        (DictConfig(a=Path("b")), "test_habits.DictConfig), which holds PosixPath('b') (pathlib.PosixPath)"),
        (float("inf"), "x is inf; it must be plain"),
    ],
)
def test_what_no_hyperparameter_can_be_is_named_with_its_type(value: Any, named: str, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="it must be plain: finite numbers, text, lists, dicts") as error:
        sprl_bench.record(make(), out=tmp_path, agent="mine", seed=0, hyperparameters={"x": value})
    assert named in str(error.value)


def test_a_scripts_default_suite_is_found_by_the_comparison(capsys: Capture, home: Path, tmp_path: Path) -> None:
    env = sprl_bench.record(make(), out=tmp_path / "runs", agent="mine", seed=0, budget=1_000)
    play(env, 1_000)
    env.close()
    [short] = find_records(tmp_path / "runs")
    [entry, *_] = leaderboard.find_entries(home / "grid-7x7")
    task = entry.tasks[0]
    whole = {"suite": "grid", "suite_version": 1, "task": task.task}
    steps = short.totals.model_copy(update={"env_steps": task.task.budget})
    spec = short.spec.model_copy(update={**whole, "num_envs": task.num_envs})
    known = {"spec": spec, "totals": steps, "fingerprint": task.fingerprint, "scores": records.Scores.of}
    known["scores"] = records.Scores.of(task.task, short.return_curve, short.success_curve)
    records.write(spec.path(tmp_path / "other") / RECORD, short.model_copy(update=known))
    against = ["--against", home / "grid-7x7", "--format", "json"]
    status, out, err = call(capsys, "leaderboard", "compare", tmp_path / "other", *against)
    assert status == 0, err
    assert {one["agent"] for one in json.loads(out)} == {"mine"}
    assert "The runs are of suite 'grid', which has the same tasks" in json.loads(out)[0]["notes"][-1]
    assert refused(capsys, "leaderboard", "compare", tmp_path / "runs", *against)[1].startswith("There is no finished")
    add = ["leaderboard", "add", tmp_path / "other", "--agent", "mine", "--suite", "grid-7x7", "--home", home]
    line = refused(capsys, *add, "--author", "A", "--link", "https://a.bc")[1]
    assert "It has runs of grid; a script's runs are of the suite that record() is given." in line
    picture = ["leaderboard", "plot", home / "grid-7x7", "--runs", tmp_path / "other", "-o", tmp_path / "a.svg"]
    status, _, err = call(capsys, *picture, "--allow-missing")
    assert status == 0, err
    assert "mine (0 to 1 seeds)" in (tmp_path / "a.svg").read_text()


# --------------------------------------------------------------------------- the command line


def test_one_limit_of_seeds(capsys: Capture, tmp_path: Path) -> None:
    largest = 2**53 - 1
    words = ["run", "--suite", "smoke", "--agents", "random", "--budget", "200", "--out", tmp_path, "--seeds"]
    assert call(capsys, *words, f"{largest},")[0] == 0
    assert only_record(tmp_path).spec.seed == largest
    for seed in (2**53, 10**18):
        assert "it must hold numbers below 2^53" in refused(capsys, *words, f"{seed},")[1]
    with pytest.raises(ValueError, match="seed"):
        sprl_bench.record(make(), out=tmp_path, agent="mine", seed=2**53)


@pytest.mark.parametrize("name", ["x.html", "x.xlsx", "x.pdf", "x.markdown"])
def test_a_table_in_an_unknown_format_is_refused(
    name: str, capsys: Capture, make_record: MakeRecord, tmp_path: Path
) -> None:
    run_ = make_record()
    records.write(run_.spec.path(tmp_path / "runs") / RECORD, run_)
    status, line = refused(capsys, "table", tmp_path / "runs", "-o", tmp_path / name)
    assert (status, "it must end in .csv, .json, .md, .tex, .txt, or --format must be given" in line) == (2, True)
    assert not (tmp_path / name).exists()
    assert call(capsys, "table", tmp_path / "runs", "-o", tmp_path / name, "--format", "md")[0] == 0
    assert call(capsys, "table", tmp_path / "runs", "-o", tmp_path / "plain.txt")[0] == 0


@pytest.mark.parametrize(
    ("given", "meant"),
    [
        ("lr", "learning_rate"),
        ("ent_coef", "entropy_coefficient"),
        ("vf_coef", "value_coefficient"),
        ("clip_ratio", "clip_range"),
        ("epoch", "epochs"),
        ("n_envs", "num_envs"),
        ("zzz", ""),
    ],
)
def test_the_names_of_other_libraries_are_understood(given: str, meant: str, capsys: Capture) -> None:
    line = refused(capsys, "run", "--suite", "smoke", "--agents", "ppo", "--set", f"{given}=1")[1]
    assert f"Unknown hyperparameter {given!r}; " in line
    assert (f"did you mean {meant!r}?" if meant else "allowed: ") in line


def test_a_suggestion_is_no_wild_guess() -> None:
    assert did_you_mean("x_y", ["learning_rate", "gamma_b"]) == ""
    assert did_you_mean("_", ["a_b"]) == ""


@pytest.mark.parametrize("extra", EXTRAS)
def test_the_hint_of_an_extra_names_the_pinned_versions(extra: str, tmp_path: Path, monkeypatch: Any) -> None:
    monkeypatch.chdir(tmp_path)
    [path] = [word for word in advice(extra).split() if word.endswith("constraints.txt")]
    assert Path(path).is_file()
    assert advice(extra).endswith(f"'sprl-bench[{extra}]'")


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("its_agent.py:Mine", "code is named 'its_agent.py:Mine'; it must be a module, not a file: its_agent:Mine."),
        ("its_agentt:Mine", "No module named 'its_agentt', neither here nor installed"),
        ("its_agent:Nine", "it must name a factory in its_agent, and there is no such thing in it."),
        ("its_agent:number", "it must name a factory in its_agent, and it is not callable."),
        ("its_broken:Mine", "its_broken.py:1: invalid syntax: def def"),
        ("its_slip:Mine", "its_slip.py:2: NameError: name 'Basse' is not defined"),
    ],
)
def test_a_slip_in_the_name_of_an_agent_is_told(
    name: str, said: str, capsys: Capture, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "its_agent.py").write_text("number = 3\n")
    (tmp_path / "its_broken.py").write_text("def def\n")
    (tmp_path / "its_slip.py").write_text("number = 3\nclass Mine(Basse): pass\n")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [*sys.path])
    assert said in refused(capsys, "run", "--suite", "smoke", "--agents", name, "--seeds", "1")[1]
    assert not (tmp_path / "runs").exists()


@pytest.mark.parametrize("name", ["../../x:f", "..x:f", ":f", "x:", "a b:f", "x:f()", "os:system:x"])
def test_code_that_is_no_name_is_refused(name: str, capsys: Capture, tmp_path: Path) -> None:
    start = ["run", "--suite", "smoke", "--seeds", "1", "--out", tmp_path / "runs", "--agents"]
    for words in (
        [*start, name],
        [*start, "random", "--log", name],
        ["video", "SPRL/FourRooms-7x7-v1", "-o", tmp_path / "a.gif", "--policy", name],
    ):
        assert f"code is named {name!r}; it must be package.module:attribute" in refused(capsys, *words)[1]
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("os:system", "it raised TypeError: expected str"),
        ("builtins:repr", "it must return an action of Discrete(7), not 'array("),
        ("builtins:bool", "it raised ValueError"),
        ("math:pi", "it must be a name, a run's folder, or a function"),
    ],
)
def test_a_function_that_is_no_policy_is_named(name: str, said: str, capsys: Capture, tmp_path: Path) -> None:
    status, line = refused(capsys, "video", "SPRL/FourRooms-7x7-v1", "-o", tmp_path / "a.gif", "--policy", name)
    assert status == 1 or name == "math:pi"
    assert line.startswith(f"policy is {name!r}; ")
    assert said in line
    assert list(tmp_path.iterdir()) == []


# --------------------------------------------------------------------------- agents that are none


class NoLoop:
    def train(self, envs: Any, budget: int) -> Any:
        return 3


class NoMetrics:
    def train(self, envs: Any, budget: int) -> Any:
        yield 7


@pytest.mark.parametrize(
    ("made", "said"),
    [
        (5, "returned 5; it must have a method train"),
        (None, "returned None; it must have a method train"),
        (NoLoop(), "returned 3; it must yield metrics"),
        (NoMetrics(), "yielded 7; it must yield a mapping of names to numbers"),
    ],
)
def test_what_is_no_agent_is_named(made: Any, said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    module = ModuleType("habit_agents")
    module.mine = lambda *, seed, device="cpu": made  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "habit_agents", module)
    with pytest.raises(TypeError, match=said):
        run(spec_of("habit_agents:mine"), tmp_path)


def test_hyperparameters_that_are_no_mapping_are_named(monkeypatch: pytest.MonkeyPatch) -> None:
    module = ModuleType("habit_agents")
    module.mine = lambda *, seed, device="cpu": None  # type: ignore[attr-defined]
    module.mine.hyperparameters = lambda domain, overrides: 5  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "habit_agents", module)
    with pytest.raises(ValueError, match=r"hyperparameters\(\) of the agent returned 5; it must return a mapping"):
        spec_of("habit_agents:mine")


PLUGIN = "from sprl_bench_habit.rest import NUMBER\ndef made(*, seed, device='cpu'): return NUMBER\n"


def test_the_code_of_an_installed_agent_is_known(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    package = tmp_path / "sprl_bench_habit"
    package.mkdir()
    for name, text in (("__init__", ""), ("agent", PLUGIN), ("rest", "NUMBER = 1\n")):
        (package / f"{name}.py").write_text(text)
    about = tmp_path / "sprl_bench_habit-1.0.dist-info"
    about.mkdir()
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: sprl-bench-habit\nVersion: 1.0\n")
    (about / "entry_points.txt").write_text("[sprl_bench.agents]\nhabit = sprl_bench_habit.agent:made\n")
    (about / "RECORD").write_text("sprl_bench_habit/agent.py,,\nhabit_helper.py,,\nhabit_lost.py,,\n")
    (tmp_path / "habit_helper.py").write_text("HELP = 1\n")
    monkeypatch.syspath_prepend(tmp_path)
    importlib.invalidate_caches()
    assert spec_of("habit").source == "habit"
    before = provenance.agent_code("habit")
    assert before is not None
    assert before == provenance.agent_code("habit")
    (package / "rest.py").write_text("NUMBER = 2\n")  # a file that the agent imports
    assert (now := provenance.agent_code("habit")) not in (None, before)
    (tmp_path / "habit_helper.py").write_text("HELP = 2\n")  # a second module of the distribution
    assert provenance.agent_code("habit") not in (None, before, now)
    assert provenance.agent_code("ppo") is None  # of this package, whose commit is known


def test_seeds_by_changed_code_of_an_installed_agent_are_refused(rising: list[RunRecord]) -> None:
    changed = [
        one.model_copy(
            update={"agent_code": f"{seed // 4:016x}", "spec": one.spec.model_copy(update={"source": "habit"})}
        )
        for seed, one in enumerate(rising)
    ]
    with pytest.raises(ValueError, match="one version of its agent's code"):
        leaderboard.make_entry(changed, agent="rising", authors=["A"], link="https://a.bc")
    [table] = sprl_bench.tabulate(changed)
    assert any("The code of rising changed between its runs" in note for note in table.notes)


def test_versions_do_not_depend_on_who_started_a_run() -> None:
    before = provenance.versions()
    import pygments  # noqa: F401
    import ray  # noqa: F401
    import typer  # noqa: F401

    assert provenance.versions() == before
    assert {"numpy", "gymnasium", "sprl-bench", "python", "platform"} <= set(before)


# --------------------------------------------------------------------------- files


@pytest.mark.parametrize(("encoding", "named"), [("utf-8-sig", "UTF-8"), ("utf-16", "UTF-16"), ("utf-16-be", "")])
def test_a_byte_order_mark_is_named(encoding: str, named: str, make_record: MakeRecord, tmp_path: Path) -> None:
    (tmp_path / RECORD).write_bytes(make_record().model_dump_json().encode(encoding))
    with pytest.raises(InvalidFileError, match=f"byte-order mark \\({named}" if named else RECORD):
        records.read(tmp_path / RECORD, RunRecord)


@pytest.fixture(scope="module")
def begun(tmp_path_factory: pytest.TempPathFactory) -> tuple[RunSpec, Path]:
    out, spec = tmp_path_factory.mktemp("begun"), spec_of("ppo", budget=6_000)
    with pytest.raises(InterruptedRunError):
        run(spec, out, stop=lambda: True)
    return spec, spec.path(out)


NAMES = ("spec", "provenance", "wall_time_s", "metrics_bytes", "log", "envs", "agent")


@pytest.mark.parametrize(
    ("name", "value"),
    [
        *((name, "absent") for name in NAMES),
        *((name, "text") for name in NAMES[:-1]),
        ("metrics_bytes", -1),
        ("log", {}),
        ("provenance", {}),
        ("actions_bytes", "x"),
        ("wall_time_s", -1.0),
        ("wall_time_s", float("inf")),
        ("wall_time_s", float("nan")),
        ("provenance", np.ones(1)),  # an array raises an IndexError where a mapping raises a KeyError
        ("log", np.ones(1)),
        ("envs", np.ones(1)),
        ("agent", np.ones(1)),
        ("agent", np.ones(3)),
    ],
)
def test_a_checkpoint_that_lacks_something_is_refused_untouched(
    name: str, value: Any, begun: tuple[RunSpec, Path], tmp_path: Path
) -> None:
    spec, folder = begun
    state = checkpoint.load(folder / CHECKPOINT)
    if isinstance(value, str) and value == "absent":
        del state[name]
    else:
        state[name] = value
    place = spec.path(tmp_path)
    place.mkdir(parents=True)
    checkpoint.save(place / CHECKPOINT, state)
    (place / "metrics.jsonl").write_bytes((folder / "metrics.jsonl").read_bytes())
    before = {path.name: path.read_bytes() for path in place.iterdir()}
    with pytest.raises(CheckpointRefusedError, match="made by another build of sprl-bench"):
        run(spec, tmp_path)
    after = {path.name: path.read_bytes() for path in place.iterdir() if path.name != SPEC}
    assert after == before


@pytest.mark.parametrize("state", [{}, {"agent": 3}, {"agent": {}}, {"agent": {"network": {"x": np.ones(3)}}}])
def test_weights_of_another_shape_are_named(
    state: dict[str, Any], begun: tuple[RunSpec, Path], capsys: Capture, tmp_path: Path
) -> None:
    spec, _ = begun
    records.write(tmp_path / SPEC, spec)
    checkpoint.save(tmp_path / WEIGHTS, state)
    words = ["video", "SPRL/FourRooms-7x7-v1", "-o", tmp_path / "a.gif", "--run", tmp_path]
    status, line = refused(capsys, *words)
    assert (status, line.startswith(f"{tmp_path / WEIGHTS} does not fit the agent 'ppo' (")) == (1, True), line
    assert not (tmp_path / "a.gif").exists()


# --------------------------------------------------------------------------- Numba's cache


def double(number: int) -> int:
    return 2 * number


@pytest.mark.parametrize("harm", ["truncated", "empty", "garbage", "full", "unreadable"])
def test_the_cache_of_compiled_functions_is_optional(
    harm: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    import types

    def fresh() -> Any:
        code = types.FunctionType(double.__code__, {"__name__": __name__}, "double")
        code.__module__ = __name__
        return compile_cached(code, tmp_path)

    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "cache"))
    from numba.core import config

    monkeypatch.setattr(config, "CACHE_DIR", str(tmp_path / "cache"))
    compiled = fresh()
    assert isinstance(compiled._cache, OptionalCache)
    if harm == "full":
        from numba.core import caching

        def full(*_: Any, **__: Any) -> None:
            raise OSError(28, "No space left on device")

        monkeypatch.setattr(caching.IndexDataCacheFile, "save", full)
        with caplog.at_level(logging.WARNING):
            assert compiled(21) == 42
        assert "cannot be written (OSError" in caplog.text
        return
    assert compiled(21) == 42
    files = [path for path in (tmp_path / "cache").rglob("*") if path.is_file()]
    assert files
    for path in files:
        content = path.read_bytes()
        path.write_bytes({"truncated": content[: len(content) // 2], "garbage": b"\xff" * 50}.get(harm, b""))
        if harm == "unreadable":
            path.unlink()
            path.mkdir()
    with caplog.at_level(logging.WARNING):
        assert fresh()(21) == 42
    assert "functions are compiled anew" in caplog.text
