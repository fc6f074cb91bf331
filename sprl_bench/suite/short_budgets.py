"""Which runs end before what their agents add to PPO is in use, so that they say nothing about it."""

from __future__ import annotations

from collections.abc import Sequence

from sprl_bench.agents import load_factory
from sprl_bench.records import RunSpec


def too_short(specs: Sequence[RunSpec]) -> list[str]:
    """Return a sentence for each task whose budget ends before some agents' networks are in use."""
    waits = {(spec.task.name, spec.agent): _wait(spec) for spec in specs}
    tasks = {spec.task.name: spec.task for spec in specs}.values()
    return [
        f"{', '.join(idle)} on {task.name}: nothing is learned about their networks, which are not in use before env "
        f"step {min(idle.values()):,} of {task.budget:,}."
        for task in tasks
        if (idle := {agent: wait for (its, agent), wait in waits.items() if its == task.name and wait >= task.budget})
    ]


def _wait(spec: RunSpec) -> int:
    """Return the env steps that an agent says it waits; 0 if it says nothing."""
    wait = getattr(load_factory(spec.source), "wait", None)
    return int(wait(spec.hyperparameters)) if wait else 0
