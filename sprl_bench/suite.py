"""Many runs: from a suite, agents and seeds to specs, from specs to records, and what is left to do.

All that is known about a run lies in its folder, so it does not matter which process or machine works on it: what is
finished is skipped, what was interrupted goes on, what failed is tried again, and more can be added at any time.
"""

from __future__ import annotations

import contextlib
import importlib.util
import json
import os
import sys
import traceback
from collections import Counter
from collections.abc import Generator, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Final, Literal

from sprl_bench.agents import load_factory, resolve_hyperparameters
from sprl_bench.executors import Executor, WorkerDiedError
from sprl_bench.recorder.folder import (
    CHECKPOINT,
    ERROR,
    METRICS,
    OUTPUT,
    RECORD,
    SPEC,
    LockedError,
    is_locked,
)
from sprl_bench.records import RunRecord, RunSpec, differences, read, write, write_bytes
from sprl_bench.run import InterruptedRunError, SpecChangedError, find_finished, run
from sprl_bench.tasks import CUSTOM, Suite, Task, with_budget

__all__ = ["Observer", "Outcome", "RunState", "expand", "run_suite", "state_of", "survey"]

NUM_ENVS: Final = 12  # where an agent has no opinion
TAIL_BYTES: Final = 1 << 15

RunKey = tuple[str, str, str, int]


def expand(
    suite: Suite,
    agents: Sequence[str],
    seeds: Sequence[int],
    *,
    tasks: Sequence[str] | None = None,
    budget: int | None = None,
    overrides: Mapping[str, Any] = {},
    device: str = "cpu",
    torch_threads: int = 1,
) -> list[RunSpec]:
    """Return the specs of all runs: every seed of every task and agent.

    A budget is a property of a task. Runs under another one never lie where the suite's scores lie: they belong to
    the suite "custom", and the budget becomes part of the task's name.

    Args:
        suite: Where the tasks are from.
        agents: Names of installed agents, or "package.module:factory", named by its last part.
        seeds: One run each.
        tasks: Names of some of the suite's tasks; by default all.
        budget: Environment steps, instead of each task's own.
        overrides: Hyperparameters that differ from the presets, for all agents.
        device: Where agents compute, "auto" for a GPU if there is one.
        torch_threads: Threads of each run, never derived from the number of workers.

    Raises:
        ValueError: Something is unknown, out of range, or given twice.
    """
    chosen = [_with_budget(suite, task, budget) for task in _chosen_tasks(suite, tasks)]
    _refuse_repeats("agents", [_agent_name(agent) for agent in agents])
    _refuse_repeats("seeds", seeds)
    made = partial(_spec, overrides=overrides, device=_resolve_device(device), torch_threads=torch_threads)
    return [made(*place, agent, seed) for seed in seeds for place in chosen for agent in agents]


def _chosen_tasks(suite: Suite, names: Sequence[str] | None) -> Sequence[Task]:
    if names is None:
        return suite.tasks
    _refuse_repeats("tasks", names)
    return [suite.task(name) for name in names]


def _with_budget(suite: Suite, task: Task, budget: int | None) -> tuple[Suite, Task]:
    if budget is None or budget == task.budget:
        return suite, task
    return CUSTOM, with_budget(task, budget)


def _refuse_repeats(name: str, values: Sequence[Any]) -> None:
    repeated = [value for value, count in Counter(values).items() if count > 1]
    if repeated:
        raise ValueError(f"{name} holds {repeated[0]!r} more than once.")
    if not values:
        raise ValueError(f"{name} is empty; name at least one.")


def _agent_name(agent: str) -> str:
    return agent.partition(":")[2].replace(".", "-") or agent


def _resolve_device(device: str) -> str:
    if device != "auto":
        return device
    if importlib.util.find_spec("torch") is None:
        return "cpu"
    import torch  # noqa: PLC0415 - only asked where the choice is left to us

    return "cuda" if torch.cuda.is_available() else "cpu"


def _spec(
    suite: Suite, task: Task, agent: str, seed: int, *, overrides: Mapping[str, Any], device: str, torch_threads: int
) -> RunSpec:
    factory = load_factory(agent)
    own = dict(overrides)
    if "num_envs" not in resolve_hyperparameters(factory, task.domain, {}):
        num_envs = own.pop("num_envs", NUM_ENVS)
        hyperparameters = resolve_hyperparameters(factory, task.domain, own)
    else:
        hyperparameters = resolve_hyperparameters(factory, task.domain, own)
        num_envs = hyperparameters["num_envs"]
    return RunSpec.of(
        suite,
        task,
        hyperparameters=json.loads(json.dumps(hyperparameters)),
        agent=_agent_name(agent),
        source=agent,
        privileged=getattr(factory, "privileged", False),
        seed=seed,
        num_envs=num_envs,
        device=device,
        torch_threads=torch_threads,
    )


@dataclass(frozen=True)
class Outcome:
    """What became of one spec; `error` is one line, empty unless it failed."""

    spec: RunSpec
    status: Literal["finished", "skipped", "failed"]
    error: str = ""


class Observer:
    """Is told how a suite goes; this one does nothing."""

    def started(self, specs: Sequence[RunSpec], out: Path) -> None:
        """Hear that these runs are wanted; what becomes of them can be read in their folders."""

    def ended(self, outcome: Outcome) -> None:
        """Hear what became of one of them."""

    def closed(self) -> None:
        """Hear that no more will come."""


def run_suite(
    specs: Sequence[RunSpec],
    out: Path,
    *,
    executor: Executor,
    observer: Observer = Observer(),  # noqa: B008 - it has no state
) -> list[Outcome]:
    """Work on all runs that are not finished, and return what became of each, in the order of `specs`.

    A run that fails leaves its traceback in its folder and does not keep the others from going on.

    Raises:
        SpecChangedError: There are results under the same name with another spec. Nothing has been started.
        InvalidFileError: A file there is broken. Nothing has been started.
    """
    _refuse_changes(specs, out)
    waiting = [spec for spec in specs if find_finished(spec.path(out), spec) is None]
    for spec in waiting:
        write(spec.path(out) / SPEC, spec)
    outcomes: dict[RunKey, Outcome] = {}
    observer.started(specs, out)
    try:
        for outcome in _work_on(specs, waiting, out, executor):
            outcomes[_key(outcome.spec)] = outcome
            observer.ended(outcome)
    finally:
        observer.closed()
    return [outcomes[_key(spec)] for spec in specs]


def _key(spec: RunSpec) -> RunKey:
    return spec.suite, spec.task.name, spec.agent, spec.seed


def _work_on(specs: Sequence[RunSpec], waiting: Sequence[RunSpec], out: Path, executor: Executor) -> Iterator[Outcome]:
    left = {_key(spec) for spec in waiting}
    yield from (Outcome(spec, "skipped") for spec in specs if _key(spec) not in left)
    with contextlib.closing(_results(executor, waiting, out)) as results:
        yield from results


def _results(executor: Executor, waiting: Sequence[RunSpec], out: Path) -> Generator[Outcome]:
    for spec, result in executor.map(partial(_attempt, out=out), waiting):
        if isinstance(result, WorkerDiedError):
            write_bytes(spec.path(out) / ERROR, f"{result}\n".encode())
            yield Outcome(spec, "failed", str(result))
        else:
            yield result


def _attempt(spec: RunSpec, out: Path) -> Outcome:
    """Run one spec in a worker, and make of whatever happens an outcome."""
    folder, parent = spec.path(out), os.getppid()
    try:
        with _output_to(folder / OUTPUT):
            run(spec, out, stop=lambda: os.getppid() != parent)
    except (InterruptedRunError, LockedError) as error:
        return Outcome(spec, "failed", str(error))
    except Exception as error:  # whatever an agent does wrong, the other runs go on
        write_bytes(folder / ERROR, traceback.format_exc().encode())
        return Outcome(spec, "failed", f"{type(error).__name__}: {error}".partition("\n")[0])
    return Outcome(spec, "finished")


@contextlib.contextmanager
def _output_to(path: Path) -> Iterator[None]:
    """Let all that this process prints, compiled code included, go to a file; an empty one is removed."""
    saved = [os.dup(descriptor) for descriptor in (1, 2)]
    with path.open("ab") as file:
        for descriptor in (1, 2):
            os.dup2(file.fileno(), descriptor)
    try:
        yield
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        for descriptor, original in zip((1, 2), saved, strict=True):
            os.dup2(original, descriptor)
            os.close(original)
        if path.exists() and path.stat().st_size == 0:
            path.unlink()


def _refuse_changes(specs: Sequence[RunSpec], out: Path) -> None:
    """Refuse specs that differ in more than the seed from results that lie under the same suite, task and agent."""
    changed = []
    for spec in {_key(spec)[:3]: spec for spec in specs}.values():
        for other in _specs_with_results(spec.path(out).parent):
            lines = differences(other.model_copy(update={"seed": spec.seed}), spec)
            changed += [f"{other.path(out)}: {line}" for line in lines]
    if changed:
        raise SpecChangedError(
            "\n".join(
                ["There are results of another spec under the same name. Use another --out, or remove:", *changed]
            )
        )


def _specs_with_results(folder: Path) -> Iterator[RunSpec]:
    for place in sorted(folder.glob("seed-*")):
        if (place / RECORD).exists():
            yield read(place / RECORD, RunRecord).spec
        elif (place / CHECKPOINT).exists() and (place / SPEC).exists():
            yield read(place / SPEC, RunSpec)


@dataclass(frozen=True)
class RunState:
    """How far a run is, as its folder tells.

    Attributes:
        spec: Which run.
        status: "interrupted" has begun, and nothing works on it; "waiting" has not begun.
        env_steps: Taken so far.
        steps_per_second: Lately; 0 where nothing works on it.
        seconds_left: At that speed; None where it cannot be told.
    """

    spec: RunSpec
    status: Literal["finished", "running", "interrupted", "failed", "waiting"]
    env_steps: int
    steps_per_second: float
    seconds_left: float | None


def survey(out: Path) -> list[RunState]:
    """Return the state of every run below `out`, in the order of their paths.

    Raises:
        FileNotFoundError: There is no such folder.
        InvalidFileError: A file there is broken.
    """
    if not out.exists():
        raise FileNotFoundError(f"{out} does not exist.")
    folders = {path.parent for name in (SPEC, RECORD) for path in out.rglob(name)}
    return [_state(folder) for folder in sorted(folders)]


def state_of(spec: RunSpec, out: Path) -> RunState:
    """Return how far a run is."""
    folder = spec.path(out)
    if (folder / RECORD).exists():
        record = read(folder / RECORD, RunRecord)
        if record.status == "complete":
            return RunState(spec, "finished", record.totals.env_steps, 0.0, 0.0)
        if not (folder / METRICS).exists():
            return RunState(spec, "interrupted", record.totals.env_steps, 0.0, None)
    env_steps, speed = _progress(folder / METRICS)
    if is_locked(folder):
        left = max(0, spec.task.budget - env_steps) / speed if speed else None
        return RunState(spec, "running", env_steps, speed, left)
    if (folder / ERROR).exists():
        return RunState(spec, "failed", env_steps, 0.0, None)
    return RunState(spec, "interrupted" if env_steps else "waiting", env_steps, 0.0, None)


def _state(folder: Path) -> RunState:
    written = (folder / SPEC).exists()
    spec = read(folder / SPEC, RunSpec) if written else read(folder / RECORD, RunRecord).spec
    return state_of(spec, folder.parents[3])


def _progress(path: Path) -> tuple[int, float]:
    """Return the env steps taken, and the steps per second lately, from the end of a file of metrics."""
    lines = _last_lines(path)
    if not lines:
        return 0, 0.0
    first, last = lines[0] if len(lines) > 1 else {"env_steps": 0, "wall_time_s": 0.0}, lines[-1]
    seconds = last["wall_time_s"] - first["wall_time_s"]
    return last["env_steps"], (last["env_steps"] - first["env_steps"]) / seconds if seconds > 0 else 0.0


def _last_lines(path: Path) -> list[dict[str, Any]]:
    """Return the whole lines within the last kilobytes; the very last one may still be in the writing."""
    try:
        with path.open("rb") as file:
            start = max(0, file.seek(0, os.SEEK_END) - TAIL_BYTES)
            file.seek(start)
            lines = file.read().split(b"\n")
    except FileNotFoundError:
        return []
    return [json.loads(line) for line in lines[1 if start else 0 : -1]]
