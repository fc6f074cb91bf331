"""A study as a value: what to run, what the paper claims, and how the claim is judged."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from sprl_bench.naming import AgentName
from sprl_bench.records import RunRecord, RunSpec, find_metrics, find_records
from sprl_bench.scores import Array
from sprl_bench.studies.verdicts import Verdict
from sprl_bench.suggestions import unknown
from sprl_bench.suite import expand, hyperparameters_of, plainest
from sprl_bench.tables import Result, check_comparable, select_results, split_suites
from sprl_bench.tasks import find_suite

Logged = tuple[RunSpec, Sequence[Mapping[str, Any]]]
Figure = Literal["curves", "axis", "metric"]


@dataclass(frozen=True)
class Evidence:
    """The finished runs of a study, and what their agents logged. Tasks have their names in the suite.

    Attributes:
        results: The runs.
        logged: The lines of diagnostics of each run.
        task_names: The name of each task in the suite, by its name under the study's budget.
        folders: The folder of each run.
    """

    results: tuple[Result, ...] = ()
    logged: tuple[Logged, ...] = ()
    task_names: Mapping[str, str] = field(default_factory=dict)
    folders: tuple[Path, ...] = ()

    @property
    def tasks(self) -> list[str]:
        """The tasks, in the order of their first run."""
        return list(dict.fromkeys(self._name(result.task.name) for result in self.results))

    def aucs(self, agent: str, task: str) -> Array:
        """Return the AUC of each seed of an agent on a task, [S], in the order of the seeds; empty without a run."""
        mine = [one for one in self.results if (one.agent, self._name(one.task.name)) == (agent, task)]
        return np.array([one.scores.auc for one in sorted(mine, key=lambda one: one.seed)])

    def logs(self, agent: str, task: str) -> list[Logged]:
        """Return the lines of each seed of an agent on a task."""
        mine = [one for one in self.logged if (one[0].agent, self._name(one[0].task.name)) == (agent, task)]
        return sorted(mine, key=lambda one: one[0].seed)

    def _name(self, task: str) -> str:
        return self.task_names.get(task, task)


@dataclass(frozen=True)
class Study:
    """One experiment of the paper.

    Attributes:
        name: As on the command line.
        title: What is asked.
        claim: The paper's answer, in our words.
        tasks: Names by suite.
        agents: The variants that are compared.
        judge: From the evidence to a verdict; it is given the agents, in case their base was changed.
        figure: How it is drawn: learning curves, scores along an axis, or a metric.
        draw: Draws a figure of its own instead; it returns whether there was anything to draw.
        table: From the evidence to numbers for the page that are not scores, Markdown; empty if there are none.
        axis: The hyperparameter or argument that varies, for figures along an axis.
        axis_default: The argument's value where a task does not give it.
        metric: What is drawn, for figures of a metric.
        decisions: What the paper leaves open and what is done here.
    """

    name: str
    title: str
    claim: str
    tasks: Mapping[str, tuple[str, ...]]
    agents: tuple[str, ...]
    judge: Callable[[Evidence, Sequence[str]], Verdict]
    figure: Figure = "curves"
    draw: Callable[[Evidence, Path], bool] | None = None
    table: Callable[[Evidence], str] | None = None
    axis: str = ""
    axis_default: float | None = None
    metric: str = ""
    decisions: str = ""

    def on_base(self, base: str) -> tuple[str, ...]:
        """Return the agents with another base: what varies keeps its values, all else is the base's.

        Raises:
            ValueError: The study compares agents, not variants of one, or the base is unknown or out of range.
        """
        own = [AgentName.parse(agent) for agent in self.agents]
        if len({(name.source, name.preset) for name in own}) > 1:
            raise ValueError(f"base is {base!r}; it must be left out, as {self.name} compares different agents.")
        new = AgentName.parse(base)
        if given := sorted(self._varying(own) & set(new.differences)):
            raise ValueError(f"base is {base!r}; it must leave out {given[0]}, which {self.name} varies.")
        known = hyperparameters_of(new, self._domain).values
        if foreign := sorted(self._varying(own) - set(known)):
            raise ValueError(f"base is {base!r}; it must be an agent with {foreign[0]}, which {self.name} varies.")
        variants = [replace(new, differences={**new.differences, **values}) for values in self._varied(own)]
        return tuple(plainest(variant, self._domain).full for variant in variants)

    def _varied(self, own: Sequence[AgentName]) -> list[dict[str, Any]]:
        """Return the values of each agent that are not the same in all, such as its k."""
        keys = self._varying(own)
        resolved = [hyperparameters_of(name, self._domain).values for name in own]
        return [{key: values[key] for key in sorted(keys)} for values in resolved]

    @staticmethod
    def _varying(own: Sequence[AgentName]) -> set[str]:
        """Return what some of the agents name and others do not."""
        return {key for name in own for key in name.differences if not all(key in one.differences for one in own)}

    @property
    def _domain(self) -> str:
        suite, names = next(iter(self.tasks.items()))
        return find_suite(suite).task(names[0]).domain


def specs_of(
    study: Study,
    seeds: Sequence[int],
    budget_share: float = 1.0,
    *,
    agents: Sequence[str] | None = None,
    tasks: Sequence[str] | None = None,
    device: str = "cpu",
) -> list[RunSpec]:
    """Return the specs of all runs of a study.

    Args:
        study: The study.
        seeds: One run each.
        budget_share: The budgets, as a share of the tasks' own.
        agents: The study's agents on another base.
        tasks: Only these.
        device: Where agents compute.

    Raises:
        ValueError: Something is unknown or out of range.
    """
    if not 0 < budget_share <= 1:
        raise ValueError(f"budget_share is {budget_share}; it must be above 0 and at most 1.")
    known = [task for names in study.tasks.values() for task in names]
    for task in tasks or ():
        if task not in known:
            raise ValueError(unknown(f"task of {study.name}:", task, known))
    places = [(suite, task) for suite, names in study.tasks.items() for task in names if tasks is None or task in tasks]
    return [
        spec
        for suite, task in places
        for spec in expand(
            find_suite(suite),
            agents or study.agents,
            seeds,
            tasks=[task],
            budget=max(1, round(find_suite(suite).task(task).budget * budget_share)),
            device=device,
        )
    ]


def evidence_of(specs: Iterable[RunSpec], root: Path) -> Evidence:
    """Return the evidence of these runs, as far as they are finished, from a folder of runs.

    Raises:
        FileNotFoundError: There is no such folder.
        IncomparableError: The runs are not comparable.
    """
    wanted = {_key(spec) for spec in specs}
    records = [record for record in find_records(root) if _is_wanted(record, wanted)]
    logged = [one for one in find_metrics(root) if _key(one[0]) in wanted]
    names = {spec.task.name: _plain(spec) for spec in (record.spec for record in records)}
    folders = tuple(record.spec.path(root) for record in records)
    return Evidence(tuple(select_results(records)) if records else (), tuple(logged), names, folders)


def evidence_of_entries(specs: Iterable[RunSpec], results: Iterable[Result]) -> Evidence:
    """Return the evidence that a leaderboard has: its seeds of these agents on these tasks, by its own budgets.

    Entries hold no diagnostics, so a study of a metric finds nothing to judge.

    Raises:
        IncomparableError: The results are not comparable.
    """
    wanted = {(spec.agent, _plain(spec)) for spec in specs}
    chosen = [result for result in results if (result.agent, result.task.name) in wanted]
    for group in split_suites(chosen):
        check_comparable(group)
    return Evidence(tuple(chosen))


def missing_runs(specs: Iterable[RunSpec], evidence: Evidence) -> list[str]:
    """Return a name for each run that is not finished."""
    there = {(one.task.name, one.agent, one.seed) for one in evidence.results}
    missing = [spec for spec in specs if (spec.task.name, spec.agent, spec.seed) not in there]
    return [f"{spec.agent} on {spec.task.name}, seed {spec.seed}" for spec in missing]


def _key(spec: RunSpec) -> tuple[str, str, str, int, str]:
    return spec.suite, spec.task.name, spec.agent, spec.seed, spec.hyperparameters_hash


def _is_wanted(record: RunRecord, wanted: set[tuple[str, str, str, int, str]]) -> bool:
    return record.status == "complete" and _key(record.spec) in wanted


def _plain(spec: RunSpec) -> str:
    """Return a task's name without the budget that `with_budget` appends."""
    suffix = f"-{spec.task.budget}"
    return spec.task.name.removesuffix(suffix) if spec.suite == "custom" else spec.task.name
