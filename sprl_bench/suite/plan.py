"""From a suite, agents and seeds to the specs of all runs."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from functools import partial
from types import MappingProxyType
from typing import Any, Final

from sprl_bench.agents import load_factory, resolve_hyperparameters
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
            is chosen by "agent@preset", which is then the agent's name.
        seeds: One run each.
        tasks: Names of some of the suite's tasks; by default all.
        budget: Environment steps, instead of each task's own.
        overrides: Hyperparameters that differ from the preset, for all agents.
        device: Where agents compute: "cpu", "cuda", "cuda:N", or "auto" for a GPU if there is one.
        torch_threads: Threads of each run.

    Raises:
        ValueError: Something is unknown, out of range, or given twice.
    """
    chosen = [_with_budget(suite, task, budget) for task in _chosen_tasks(suite, tasks)]
    _refuse_repeats("agents", [_agent_name(agent) for agent in agents])
    _refuse_repeats("seeds", seeds)
    made = partial(_spec, overrides=overrides, device=resolve_device(device), torch_threads=torch_threads)
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
    if not len(values):
        raise ValueError(f"{name} is empty; it must hold at least one.")


def _agent_name(agent: str) -> str:
    source, preset = _split_preset(agent)
    name = source.partition(":")[2].replace(".", "-") or source
    return f"{name}@{preset}" if preset else name


def _split_preset(agent: str) -> tuple[str, str]:
    """Return the agent and the preset in "agent@preset"; the preset is empty if none is named."""
    source, at, preset = agent.partition("@")
    if at and not preset:
        raise ValueError(f"agents holds {agent!r}; it must have the name of a preset after the @.")
    return source, preset


def _spec(suite: Suite, task: Task, agent: str, seed: int, *, overrides: Mapping[str, Any], **machine: Any) -> RunSpec:
    source, preset = _split_preset(agent)
    factory = load_factory(source)
    if preset and preset == getattr(factory, "default_preset", None):
        raise ValueError(f"agents holds {agent!r}; it must be {source!r}, whose preset is {preset!r}.")
    hyperparameters, num_envs = resolve_hyperparameters(factory, task.domain, overrides, preset)
    return RunSpec.of(
        suite,
        task,
        hyperparameters=hyperparameters,
        agent=_agent_name(agent),
        source=source,
        privileged=getattr(factory, "privileged", False),
        seed=seed,
        num_envs=num_envs,
        **machine,
    )
