"""What a table, a plot and a leaderboard are made of, and what may stand side by side.

A result is one seed's scores on one task, wherever it was written down: a run's record or a leaderboard entry. Results
are compared only where the environment, the budget and the suite's version agree; what else differs is said aloud.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass

from pydantic import JsonValue

from sprl_bench.records import RunRecord, RunSpec, Scores, TaskSpec
from sprl_bench.tasks import CUSTOM, SUITES

__all__ = [
    "Hole",
    "IncomparableError",
    "MissingRunsError",
    "Result",
    "check_comparable",
    "differences",
    "find_holes",
    "split_suites",
    "table_of",
    "task_names",
    "version_differences",
]

SHOWN_HOLES = 8
SCORED_PACKAGES = (
    "gymnasium",
    "gymnasium-robotics",
    "llvmlite",
    "minigrid",
    "mujoco",
    "numba",
    "numpy",
    "scipy",
    "sprl-bench",
    "torch",
)
"""What our environments and agents compute with: another version of these may move a score."""
NEVER_MIXED = ("mujoco",)
"""Simulators that change numerically from release to release."""


class IncomparableError(ValueError):
    """Results that must not stand side by side; the message says which and why."""


class MissingRunsError(ValueError):
    """Runs without which a mean would be one over something else; the message names them."""


@dataclass(frozen=True)
class Result:
    """One seed of one agent on one task."""

    suite: str
    suite_version: int
    task: TaskSpec
    agent: str
    privileged: bool
    seed: int
    num_envs: int
    hyperparameters: Mapping[str, JsonValue]
    fingerprint: str
    versions: Mapping[str, str]
    return_curve: tuple[float, ...]
    scores: Scores

    @classmethod
    def of(cls, record: RunRecord) -> Result:
        """Return the part of a run's record that tables need."""
        spec = record.spec
        return cls(
            suite=spec.suite,
            suite_version=spec.suite_version,
            task=spec.task,
            agent=spec.agent,
            privileged=spec.privileged,
            seed=spec.seed,
            num_envs=spec.num_envs,
            hyperparameters=spec.hyperparameters,
            fingerprint=record.fingerprint,
            versions=record.versions,
            return_curve=record.return_curve,
            scores=record.scores,
        )


@dataclass(frozen=True, order=True)
class Hole:
    """A run that a mean would need and that is not there."""

    agent: str
    task: str
    seed: int

    def __str__(self) -> str:
        """Return the run's path below its suite."""
        return f"{self.task}/{self.agent}/seed-{self.seed}"


def split_suites(results: Iterable[Result]) -> list[list[Result]]:
    """Return the results of each suite, and those of each task that belongs to none, in the order of their names."""
    groups: dict[str, list[Result]] = defaultdict(list)
    for result in results:
        groups[table_of(result.suite, result.task.name)].append(result)
    return [group for _, group in sorted(groups.items())]


def table_of(suite: str, task: str) -> str:
    """Return the name of the table that a run belongs to: its suite's, or its task's own where it is of none."""
    return f"{suite}/{task}" if suite == CUSTOM.name else suite


def task_names(results: Sequence[Result]) -> tuple[str, ...]:
    """Return the tasks that these results of one suite should have, run or not, in the suite's order."""
    suite = SUITES.get(results[0].suite)
    known = [task.name for task in suite.tasks] if suite and suite.version == results[0].suite_version else []
    return tuple(dict.fromkeys([*known, *sorted(result.task.name for result in results)]))


def find_holes(results: Sequence[Result], planned: Iterable[RunSpec], tasks: Sequence[str]) -> list[Hole]:
    """Return the runs that are missing from agents x tasks x seeds.

    An agent's seeds are those that it has on any of the tasks, or that were planned for it.

    Args:
        results: Of one suite.
        planned: Runs that were asked for, finished or not.
        tasks: The columns.
    """
    suite = results[0].suite
    seeds: dict[str, set[int]] = defaultdict(set)
    for result in results:
        seeds[result.agent].add(result.seed)
    for spec in planned:
        if spec.suite == suite and spec.task.name in tasks:
            seeds[spec.agent].add(spec.seed)
    there = {(result.agent, result.task.name, result.seed) for result in results}
    wanted = (Hole(agent, task, seed) for agent in sorted(seeds) for task in tasks for seed in sorted(seeds[agent]))
    return [hole for hole in wanted if (hole.agent, hole.task, hole.seed) not in there]


def describe_holes(holes: Sequence[Hole]) -> str:
    """Return "N runs are missing: ..." with the first few of them."""
    shown = ", ".join(str(hole) for hole in holes[:SHOWN_HOLES])
    more = f" and {len(holes) - SHOWN_HOLES} more" if len(holes) > SHOWN_HOLES else ""
    return f"{len(holes)} {'run is' if len(holes) == 1 else 'runs are'} missing: {shown}{more}"


def check_comparable(results: Sequence[Result]) -> list[str]:
    """Check that these results of one suite may share a table.

    Returns:
        Sentences on what differs and does not forbid it: package versions, numbers of sub-environments, and budgets
        other than the suite's own.

    Raises:
        IncomparableError: They differ in the suite's version, in a task's environment, arguments, budget or
            fingerprint, or one agent's seeds differ in hyperparameters or number of sub-environments; or one run is
            there twice.
    """
    suite = results[0].suite
    _refuse_mixed(f"suite {suite!r}: version", results, lambda result: str(result.suite_version))
    for task, of_task in _grouped(results, lambda result: result.task.name):
        where = f"suite {suite!r}, task {task}"
        _refuse_mixed(f"{where}: budget", of_task, lambda result: str(result.task.budget))
        _refuse_mixed(f"{where}: environment and arguments", of_task, lambda result: _environment(result.task))
        _refuse_mixed(f"{where}: environment fingerprint", of_task, lambda result: result.fingerprint)
        for package, mixed in version_differences(of_task, NEVER_MIXED).items():
            raise IncomparableError(f"{where}: version of {package} differs: {mixed}. Such results are not comparable.")
        for agent, runs in _grouped(of_task, lambda result: result.agent):
            _refuse_tuned(f"{where}, agent {agent}", runs)
            _refuse_mixed(f"{where}, agent {agent}: privileged", runs, lambda result: str(result.privileged))
            _refuse_mixed(f"{where}, agent {agent}: num_envs", runs, lambda result: str(result.num_envs))
            _refuse_twice(where, runs)
    notes = [f"Different versions of {package}: {text}." for package, text in version_differences(results).items()]
    return [*notes, *_width_notes(results), *_suite_notes(results)]


def _grouped(results: Sequence[Result], key: Callable[[Result], str]) -> list[tuple[str, list[Result]]]:
    groups: dict[str, list[Result]] = defaultdict(list)
    for result in results:
        groups[key(result)].append(result)
    return sorted(groups.items())


def differences(results: Sequence[Result], value: Callable[[Result], str]) -> str:
    """Return "VALUE (agents), VALUE (agents)" where `value` is not the same for all, else an empty string."""
    groups = _grouped(results, value)
    if len(groups) < 2:
        return ""
    return ", ".join(f"{name} ({', '.join(sorted({run.agent for run in runs}))})" for name, runs in groups)


def _refuse_mixed(what: str, results: Sequence[Result], value: Callable[[Result], str]) -> None:
    if mixed := differences(results, value):
        raise IncomparableError(f"{what} differs: {mixed}. Such results are not comparable.")


def _refuse_tuned(where: str, runs: Sequence[Result]) -> None:
    """Refuse seeds of one agent that differ in a hyperparameter."""
    for name in sorted({name for run in runs for name in run.hyperparameters}):
        values = dict.fromkeys(repr(run.hyperparameters.get(name)) for run in runs)
        if len(values) > 1:
            raise IncomparableError(f"{where}: seeds differ in the hyperparameter {name}: {', '.join(values)}.")


def _refuse_twice(where: str, runs: Sequence[Result]) -> None:
    seeds = [run.seed for run in runs]
    for seed in seeds:
        if seeds.count(seed) > 1:
            raise IncomparableError(f"{where}, agent {runs[0].agent}: seed {seed} is there {seeds.count(seed)} times.")


def _environment(task: TaskSpec) -> str:
    arguments = ", ".join(f"{name}={value!r}" for name, value in sorted(task.arguments.items()))
    return f"{task.env_id}({arguments}) with returns in [{task.score_range[0]:g}, {task.score_range[1]:g}]"


def version_differences(results: Sequence[Result], packages: Iterable[str] = SCORED_PACKAGES) -> dict[str, str]:
    """Return, by package, which versions met which agents, where they are not the same for all that loaded it."""
    found = {}
    for package in packages:
        loaded = [result for result in results if package in result.versions]
        if text := differences(loaded, _version_of(package)):
            found[package] = text
    return found


def _version_of(package: str) -> Callable[[Result], str]:
    return lambda result: result.versions[package]


def _width_notes(results: Sequence[Result]) -> list[str]:
    """Say where agents had different numbers of sub-environments on a task: quick successes then count differently."""
    mixed = (
        differences(of_task, lambda result: str(result.num_envs))
        for _, of_task in _grouped(results, lambda result: result.task.name)
    )
    return [
        f"Different numbers of sub-environments, which moves scores: {text}." for text in dict.fromkeys(mixed) if text
    ]


def _suite_notes(results: Sequence[Result]) -> list[str]:
    """Say where the runs were not what the suite asks for."""
    suite = SUITES.get(results[0].suite)
    if suite is None:
        return ["These runs are of no published suite; not comparable with published scores."]
    if suite.version != results[0].suite_version:
        return [f"Version {results[0].suite_version} of the suite; the one installed is {suite.version}."]
    official = {task.name: TaskSpec.of(task) for task in suite.tasks}
    notes = []
    for name, runs in _grouped(results, lambda result: result.task.name):
        if name in official and runs[0].task.budget != official[name].budget:
            notes.append(
                f"{name}: a budget of {runs[0].task.budget:,} environment steps instead of the suite's "
                f"{official[name].budget:,}; not comparable with published scores."
            )
    return notes
