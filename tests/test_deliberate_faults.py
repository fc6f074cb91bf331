"""A fault that someone puts into a promise on purpose is noticed: by a refusal, or by a difference in the files.

The tests of the promises compare files as these do. `docs/trust.md` lists both.
"""

from __future__ import annotations

import copy
import functools
import re
import shutil
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, Final

import pytest
from run_files import files_of
from suite_server import specs

from sprl_baselines import ppo
from sprl_baselines.learning import training_state
from sprl_baselines.learning.collector import Collector
from sprl_baselines.learning.moments import RewardNormalizer
from sprl_baselines.reachability.replay import Replay
from sprl_bench import checkpoint
from sprl_bench import run as run_module
from sprl_bench.envs import vector
from sprl_bench.envs.vector import BatchedEnv
from sprl_bench.recorder.episodes import EpisodeLog
from sprl_bench.records import RunSpec
from sprl_bench.records.folder import CHECKPOINT
from sprl_bench.replay import verify
from sprl_bench.resume import CheckpointRefusedError
from sprl_bench.run import InterruptedRunError, run

Fault = Callable[[pytest.MonkeyPatch], object]
REFUSED: Final = "is of another agent or build"
World = tuple[RunSpec, Path, dict[str, Any]]

RUNS: Final = {(spec.task.domain, spec.agent.partition("+")[0]): spec for spec in specs("all")}
WITHOUT_EFFECT: Final = {
    "provenance.hardware.cores",
    "provenance.hardware.memory_gib",
    "provenance.hardware.gpu",
    "provenance.torch_threads",
}
"""Fields of the machine, which a continued run takes from its own."""


def interrupted(spec: RunSpec, out: Path, updates: int = 2) -> None:
    left = iter([False] * (updates - 1) + [True])
    with pytest.raises(InterruptedRunError):
        run(spec, out, stop=lambda: next(left), keep_actions=True)


def finished(spec: RunSpec, out: Path) -> dict[str, Any]:
    run(spec, out, keep_actions=True)
    return files_of(out)


def world_of(spec: RunSpec, factory: pytest.TempPathFactory) -> World:
    """Return a run, the folder of its interruption after two updates, and the files of the uninterrupted one."""
    begun = factory.mktemp("begun")
    interrupted(spec, begun)
    return spec, spec.path(begun), finished(spec, factory.mktemp("whole"))


@pytest.fixture(scope="module")
def grid(tmp_path_factory: pytest.TempPathFactory) -> World:
    return world_of(RUNS["grid", "sprl"], tmp_path_factory)


@pytest.fixture(scope="module")
def fetch(tmp_path_factory: pytest.TempPathFactory) -> World:
    return world_of(RUNS["fetch", "icm"], tmp_path_factory)


def lay(begun: Path, folder: Path) -> None:
    """Put the files of an interrupted run where a run is."""
    shutil.copytree(begun, folder, dirs_exist_ok=True)


# --------------------------------------------------------------------------- a dropped checkpoint field


def places(state: Mapping[str, Any], above: tuple[str, ...] = ()) -> Iterator[tuple[str, ...]]:
    """Yield the place of each field of a checkpoint."""
    for name, value in state.items():
        yield (*above, name)
        if isinstance(value, Mapping):
            yield from places(value, (*above, name))


def kind_of(place: tuple[str, ...]) -> str:
    """Return the kind of a field: parameters that differ only in their number are of one kind."""
    return re.sub(r"\d+", "#", ".".join(place))


def without(state: dict[str, Any], place: tuple[str, ...]) -> dict[str, Any]:
    changed = copy.deepcopy(state)
    inner = changed
    for name in place[:-1]:
        inner = inner[name]
    del inner[place[-1]]
    return changed


def attempt(world: World, out: Path, state: dict[str, Any]) -> str:
    """Continue from a checkpoint with this state; return "refused", "identical", or what else came of it."""
    spec, begun, expected = world
    shutil.rmtree(out, ignore_errors=True)
    lay(begun, spec.path(out))
    checkpoint.save(spec.path(out) / CHECKPOINT, state)
    try:
        return "identical" if finished(spec, out) == expected else "other files"
    except CheckpointRefusedError:
        return "refused"
    except Exception as error:
        return "refused" if REFUSED in str(error) and "\n" not in str(error) else repr(error)


def check_every_field(world: World, out: Path) -> None:
    """Check that no field of a checkpoint can be missing unnoticed, but for those that no result depends on."""
    state = checkpoint.load(world[1] / CHECKPOINT)
    one_of_each = {kind_of(place): place for place in places(state) if place[:2] != ("provenance", "versions")}
    assert len(one_of_each) > 60
    ends = {kind: attempt(world, out, without(state, place)) for kind, place in one_of_each.items()}
    others = {kind: end for kind, end in ends.items() if end != "refused"}
    assert others == dict.fromkeys(WITHOUT_EFFECT, "identical")


def test_a_dropped_checkpoint_field_is_refused(grid: World, tmp_path: Path) -> None:
    check_every_field(grid, tmp_path / "runs")


@pytest.mark.slow
def test_a_dropped_checkpoint_field_is_refused_on_fetch(fetch: World, tmp_path: Path) -> None:
    check_every_field(fetch, tmp_path / "runs")


# --------------------------------------------------------------------------- code that forgets a field


def forget(owner: Any, method: str) -> Fault:
    """Return the fault that a method does nothing."""
    return lambda patch: patch.setattr(owner, method, lambda *_: None)


def change(owner: Any, name: str, of: Callable[..., Any]) -> Fault:
    """Return the fault that a function gives the result of another one, which receives it first."""
    return lambda patch: patch.setattr(owner, name, functools.partial(of, getattr(owner, name)))


def restored_without(part: str) -> Fault:
    """Return the fault that a network, its optimizer and its generator are restored without one of the three."""

    def restore(network: Any, optimizer: Any, generator: Any, state: Mapping[str, Any]) -> None:
        kept = {"generator": generator.get_state(), "optimizer": {}, "network": network.state_dict()}
        training_state.restore(network, optimizer, generator, {**state, part: kept[part]})

    return lambda patch: patch.setattr(ppo, "restore", restore)


def loaded_without(owner: Any, field: str) -> Fault:
    """Return the fault that a field of a state keeps the value that it had before loading."""
    load = owner.load_state_dict

    def load_the_rest(self: Any, state: Mapping[str, Any]) -> None:
        load(self, {**state, field: self.state_dict()[field]})

    return lambda patch: patch.setattr(owner, "load_state_dict", load_the_rest)


FORGOTTEN: Final[dict[str, tuple[str, Fault]]] = {
    "the networks": ("grid", restored_without("network")),
    "the optimizer's moments": ("grid", restored_without("optimizer")),
    "the random generator": ("grid", restored_without("generator")),
    "the replay": ("grid", forget(Replay, "load_state_dict")),
    "the environments": ("grid", forget(BatchedEnv, "set_state")),
    "the episodes under way": ("grid", loaded_without(EpisodeLog, "lengths")),
    "the scale of rewards": ("fetch", forget(RewardNormalizer, "load_state_dict")),
    "the noise of actions": ("fetch", loaded_without(Collector, "generator")),
}


@pytest.mark.parametrize("part", FORGOTTEN)
def test_code_that_forgets_a_field_ends_in_other_files(
    part: str, request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It drops the field and does not miss it, so that nothing can refuse: the comparison must see it."""
    domain, fault = FORGOTTEN[part]
    spec, begun, expected = request.getfixturevalue(domain)
    lay(begun, spec.path(tmp_path))
    fault(monkeypatch)
    assert finished(spec, tmp_path) != expected
    monkeypatch.undo()
    shutil.rmtree(spec.path(tmp_path))
    lay(begun, spec.path(tmp_path))
    assert finished(spec, tmp_path) == expected


# --------------------------------------------------------------------------- reordered seeds


def swapped(env_seed: Callable[[RunSpec], int], spec: RunSpec) -> int:
    """Return the seed of the other one of the first two runs."""
    return env_seed(spec.model_copy(update={"seed": 1 - spec.seed}))


def test_reordered_seeds_are_found_by_a_replay_and_by_a_comparison(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    spec = RUNS["grid", "random"]
    expected = finished(spec, tmp_path / "sound")
    change(run_module, "env_seed", swapped)(monkeypatch)
    assert finished(spec, tmp_path / "swapped") != expected
    monkeypatch.undo()
    assert verify(spec.path(tmp_path / "sound")).difference == ""
    assert "in the replay" in verify(spec.path(tmp_path / "swapped")).difference


def test_sub_environments_in_another_order_are_found_by_a_replay(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    spec = RUNS["grid", "random"]

    def backwards(seeds: Callable[..., Any], *arguments: Any) -> Any:
        return seeds(*arguments)[::-1]

    change(vector, "checked_seeds", backwards)(monkeypatch)
    finished(spec, tmp_path)
    monkeypatch.undo()
    assert "in the replay" in verify(spec.path(tmp_path)).difference
