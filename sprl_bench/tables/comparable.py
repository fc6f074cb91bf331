"""Which results are comparable.

Environment, budget and the suite's version must be the same, and for one agent its hyperparameters; notes in the table
name all other differences.
"""

from __future__ import annotations

import json
import re
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Sequence
from typing import Any

from sprl_bench.records import TaskSpec
from sprl_bench.tables.seed_results import Result
from sprl_bench.tasks import SUITES, too_wide

SCORED_PACKAGES = (
    "ale-py",
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
"""Our environments and agents compute with these: another version may move a score."""
NEVER_MIXED = ("ale-py", "gymnasium-robotics", "mujoco")
"""Simulators that change numerically from release to release."""
SURROUNDINGS = ("python", "platform")
"""Another one of these moves scores by rounding at most."""
MANY_ABANDONED = 0.01
"""Tables note a larger share of episodes that were reset before their end."""
DIRTY = "-dirty"
"""Ends the commit of a checkout with changed files."""


class IncomparableError(ValueError):
    """Results that are not comparable; the message says which and why."""


def check_comparable(results: Sequence[Result]) -> list[str]:
    """Check that these results of one suite may share a table.

    Returns:
        Sentences on differences that are allowed: versions, builds, an agent's own code, devices, threads, numbers of
        sub-environments, many abandoned episodes, and budgets other than the suite's own.

    Raises:
        IncomparableError: They differ in the suite's version, in a task's environment, arguments, budget or
            fingerprint; or one agent's runs differ in `privileged`, hyperparameters or number of sub-environments; or
            a run is given twice.
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
            _refuse_mixed(f"{where}, agent {agent}: num_envs", runs, lambda result: str(result.num_envs))
            _refuse_twice(where, runs)
    for agent, runs in _grouped(results, lambda result: result.agent):
        _refuse_mixed(f"suite {suite!r}, agent {agent}: privileged", runs, lambda result: str(result.privileged))
        _refuse_mixed(f"suite {suite!r}, agent {agent}: information", runs, lambda one: str(list(one.information)))
    versions = version_differences(results, (*SCORED_PACKAGES, *SURROUNDINGS))
    notes = [f"Different versions of {package}: {text}." for package, text in versions.items()]
    return [
        *notes,
        *_build_notes(results),
        *_code_notes(results),
        *_device_notes(results),
        *_width_notes(results),
        *_abandoned_notes(results),
        *_endless_notes(results),
        *_suite_notes(results),
    ]


def split_comparable(results: Sequence[Result]) -> tuple[list[Result], list[Result]]:
    """Return the results of the suite version and environments that most of them have, and the others.

    The environment of a task includes its budget, its arguments, its fingerprint and its simulators' versions. Of equal
    numbers the first in order is kept. What else may differ, `check_comparable` says or refuses.
    """
    version = _commonest(results, lambda one: (one.suite_version,))
    kept = [one for one in results if one.suite_version == version[0]]
    worlds = {task: _commonest(runs, _world) for task, runs in _grouped(kept, lambda one: one.task.name)}
    usable = [one for one in kept if _world(one) == worlds[one.task.name]]
    for package in NEVER_MIXED:
        usable = _of_one_version(usable, package)
    return usable, [one for one in results if one not in usable]


def _commonest(results: Sequence[Result], value: Callable[[Result], tuple[Any, ...]]) -> tuple[Any, ...]:
    counts = Counter(map(value, results))
    return min(counts, key=lambda one: (-counts[one], one))


def _world(result: Result) -> tuple[Any, ...]:
    return result.task.budget, _environment(result.task), result.fingerprint


def _of_one_version(results: list[Result], package: str) -> list[Result]:
    """Return the results that loaded the commonest version of a package, or none of it."""
    loaded = [one for one in results if package in one.versions]
    if not loaded:
        return results
    (version,) = _commonest(loaded, lambda one: (one.versions[package],))
    return [one for one in results if one.versions.get(package, version) == version]


def _grouped(results: Sequence[Result], key: Callable[[Result], str]) -> list[tuple[str, list[Result]]]:
    groups: dict[str, list[Result]] = defaultdict(list)
    for result in results:
        groups[key(result)].append(result)
    return sorted(groups.items())


def _by_value(results: Sequence[Result], value: Callable[[Result], str]) -> str:
    """Return "VALUE (agents), VALUE (agents)" if `value` is not the same for all, else an empty string."""
    groups = _grouped(results, value)
    if len(groups) < 2:
        return ""
    return ", ".join(f"{name} ({', '.join(sorted({run.agent for run in runs}))})" for name, runs in groups)


def _refuse_mixed(what: str, results: Sequence[Result], value: Callable[[Result], str]) -> None:
    if mixed := _by_value(results, value):
        raise IncomparableError(f"{what} differs: {mixed}. Such results are not comparable.")


def _refuse_tuned(where: str, runs: Sequence[Result]) -> None:
    """Refuse seeds of one agent that differ in a hyperparameter."""
    for name in sorted({name for run in runs for name in run.hyperparameters}):
        values = dict.fromkeys(
            json.dumps(run.hyperparameters[name], sort_keys=True) if name in run.hyperparameters else "none given"
            for run in runs
        )
        if len(values) > 1:
            raise IncomparableError(
                f"{where}: seeds differ in the hyperparameter {name}: {', '.join(values)}. A variant, as in "
                f"AGENT+{name}=VALUE, has a row of its own."
            )


def _refuse_twice(where: str, runs: Sequence[Result]) -> None:
    seeds = [run.seed for run in runs]
    for seed in seeds:
        if seeds.count(seed) > 1:
            raise IncomparableError(f"{where}, agent {runs[0].agent}: seed {seed} is given {seeds.count(seed)} times.")


def _environment(task: TaskSpec) -> str:
    arguments = ", ".join(f"{name}={value!r}" for name, value in sorted(task.arguments.items()))
    return f"{task.env_id}({arguments}) with returns in [{task.score_range[0]:g}, {task.score_range[1]:g}]"


def version_differences(results: Sequence[Result], packages: Iterable[str] = SCORED_PACKAGES) -> dict[str, str]:
    """Return, by package, which agents loaded which version, if they are not all the same."""
    found = {}
    for package in packages:
        loaded = [result for result in results if package in result.versions]
        if text := _by_value(loaded, _version_of(package)):
            found[package] = text
    return found


def _version_of(package: str) -> Callable[[Result], str]:
    return lambda result: result.versions[package]


def _build_notes(results: Sequence[Result]) -> list[str]:
    """Note runs made by several builds of this package, or by a changed checkout."""
    if mixed := _by_value(results, _build):
        return [f"Different builds of sprl-bench: {mixed}."]
    return [f"Made with a changed checkout of sprl-bench: {_build(results[0])}."] if DIRTY in _build(results[0]) else []


def _build(result: Result) -> str:
    return short_commits(", ".join(result.git_commits)) or "no checkout"


def short_commits(text: str) -> str:
    """Return the commits in a text in short form, as in "0123456789-dirty"."""
    return re.sub(r"([0-9a-f]{10})[0-9a-f]{30}", r"\1", text)


def _code_notes(results: Sequence[Result]) -> list[str]:
    """Note the agents whose own code changed between their runs."""
    return [
        f"The code of {agent} changed between its runs: {', '.join(codes)}."
        for agent, runs in _grouped(results, lambda result: result.agent)
        if len(codes := sorted({code for run in runs for code in run.agent_codes})) > 1
    ]


def _device_notes(results: Sequence[Result]) -> list[str]:
    kinds = {
        "devices": _by_value(results, lambda result: result.device.partition(":")[0]),
        "numbers of torch threads": _by_value(results, lambda result: str(result.torch_threads)),
    }
    return [f"Different {name}: {mixed}." for name, mixed in kinds.items() if mixed]


def _width_notes(results: Sequence[Result]) -> list[str]:
    """Note different numbers of sub-environments on a task, or too many: quick successes count more."""
    mixed = (
        _by_value(of_task, lambda result: str(result.num_envs))
        for _, of_task in _grouped(results, lambda result: result.task.name)
    )
    differing = [
        f"Different numbers of sub-environments, which moves scores: {text}." for text in dict.fromkeys(mixed) if text
    ]
    faults = dict.fromkeys(too_wide(result.suite, result.task.name, result.num_envs) for result in results)
    return differing + [f"{fault}." for fault in faults if fault]


def _abandoned_notes(results: Sequence[Result]) -> list[str]:
    """Note the agents that reset many episodes before their end."""
    return [
        f"{agent} reset up to {most:.0%} of a run's episodes before their end on {task}; they count as failures."
        for task, of_task in _grouped(results, lambda result: result.task.name)
        for agent, runs in _grouped(of_task, lambda result: result.agent)
        if (most := max(run.abandoned_share for run in runs)) > MANY_ABANDONED
    ]


def _endless_notes(results: Sequence[Result]) -> list[str]:
    """Note the agents with a run in which no episode ended."""
    return [
        f"{agent}: no episode on {task} ended within a run's budget, so its score is 0 by default and no measurement."
        for task, of_task in _grouped(results, lambda result: result.task.name)
        for agent, runs in _grouped(of_task, lambda result: result.agent)
        if any(run.episodes == 0 for run in runs)
    ]


def _suite_notes(results: Sequence[Result]) -> list[str]:
    """Note runs that are not of a published suite, of its current version, or of its budget."""
    suite = SUITES.get(results[0].suite)
    if suite is None:
        return ["These runs are of no published suite; not comparable with published scores."]
    if suite.version != results[0].suite_version:
        return [f"Version {results[0].suite_version} of the suite; the one installed is {suite.version}."]
    official = {task.name: TaskSpec.of(task) for task in suite.tasks}
    trial = [] if suite.can_rank else ["This suite is for trying things out; its budgets are too small to rank agents."]
    return [
        f"{name}: a budget of {runs[0].task.budget:,} environment steps instead of the suite's "
        f"{official[name].budget:,}; not comparable with published scores."
        for name, runs in _grouped(results, lambda result: result.task.name)
        if name in official and runs[0].task.budget != official[name].budget
    ] + trial
