"""From a suite, agents and seeds to the specs of all runs."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import Any, Final

from sprl_bench.agents import Hyperparameters, load_factory, resolve_hyperparameters
from sprl_bench.naming import AgentName
from sprl_bench.records import RunSpec
from sprl_bench.suite.devices import resolve_device
from sprl_bench.tasks import CUSTOM, Suite, Task, with_budget

NONE: Final[Mapping[str, Any]] = MappingProxyType({})


def expand(
    suite: Suite,
    agents: Sequence[str],
    seeds: Sequence[int],
    *,
    tasks: Sequence[str] | None = None,
    budget: int | None = None,
    overrides: Mapping[str, Any] = NONE,
    device: str = "cpu",
    torch_threads: int = 1,
) -> list[RunSpec]:
    """Return the specs of all runs: every seed of every task and agent.

    A budget is a property of a task. Runs with another budget belong to the suite "custom", and the budget becomes part
    of the task's name.

    Args:
        suite: Which tasks.
        agents: Names of installed agents, or "package.module:factory" for your own, named by its last part. A preset
            and hyperparameters that differ from it belong to the name: "agent@preset+key=value+key=value".
        seeds: One run each.
        tasks: Names of some of the suite's tasks; by default all.
        budget: Environment steps, instead of each task's own.
        overrides: Hyperparameters that differ from the preset, for all agents; they do not belong to the name.
        device: Where agents compute: "cpu", "cuda", "cuda:N", or "auto" for a GPU if there is one.
        torch_threads: Threads of each run.

    Raises:
        ValueError: Something is unknown, out of range, or given twice.
    """
    chosen = [_with_budget(suite, task, budget) for task in _chosen_tasks(suite, tasks)]
    names = [AgentName.parse(agent) for agent in agents]
    _refuse_repeats("agents", [str(name) for name in names])
    _refuse_repeats("seeds", seeds)
    domains = dict.fromkeys(task.domain for _, task in chosen)
    resolved = {domain: [_resolve(name, domain, overrides) for name in names] for domain in domains}
    for of_domain in resolved.values():
        _refuse_repeats("agents", [fields["agent"] for fields in of_domain])
    machine: dict[str, Any] = {"device": resolve_device(device), "torch_threads": torch_threads}
    return [
        RunSpec.of(home, task, seed=seed, **fields, **machine)
        for seed in seeds
        for home, task in chosen
        for fields in resolved[task.domain]
    ]


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
    if not len(values):
        raise ValueError(f"{name} is empty; it must hold at least one.")


def _resolve(name: AgentName, domain: str, overrides: Mapping[str, Any]) -> dict[str, Any]:
    """Return the fields of a spec that depend on the agent and the tasks' domain alone."""
    factory = load_factory(name.source)
    default = getattr(factory, "default_preset", "")
    if name.preset and name.preset == default:
        raise ValueError(
            f"agents holds {name.plain!r}; it must be {replace(name, preset='').plain!r}, whose preset is {default!r}."
        )
    if both := sorted(set(overrides) & set(name.differences)):
        raise ValueError(f"overrides holds {both[0]!r}; the agent {str(name)!r} must not give it too.")
    chosen = resolve_hyperparameters(factory, domain, {**overrides, **name.differences}, name.preset)
    return {
        "agent": str(_in_full(name, chosen.differences)),
        "source": name.source,
        "preset": name.preset or default,
        "differences": chosen.differences,
        "privileged": getattr(factory, "privileged", False),
        "information": tuple(getattr(factory, "information", ())),
        "hyperparameters": chosen.values,
        "num_envs": chosen.num_envs,
    }


def _in_full(name: AgentName, differences: Mapping[str, Any]) -> AgentName:
    """Return the name with the values of its differences as they were resolved.

    Raises:
        ValueError: One of them is the preset's own value.
    """
    for key in name.differences:
        if key not in differences:
            plainer = replace(
                name, differences={other: name.differences[other] for other in name.differences if other != key}
            )
            raise ValueError(f"agents holds {name.full!r}, the same as {plainer.full!r}; it must be {plainer.full!r}.")
    return replace(name, differences={key: differences[key] for key in name.differences})


def hyperparameters_of(name: AgentName, domain: str) -> Hyperparameters:
    """Return what a name means on a domain; the errors are those of `plainest`."""
    return resolve_hyperparameters(load_factory(name.source), domain, name.differences, name.preset)


def plainest(name: AgentName, domain: str) -> AgentName:
    """Return the name without the differences that are the preset's own values.

    Raises:
        ValueError: The agent, the preset or a hyperparameter is unknown, or a value is out of range.
    """
    chosen = hyperparameters_of(name, domain)
    kept = {key: value for key, value in name.differences.items() if key in chosen.differences}
    return replace(name, differences=kept)
