"""Results, of which tables, plots and leaderboards are made.

A result is one seed's scores on one task, from a run's record or from a leaderboard entry.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from pydantic import JsonValue

from sprl_bench.records import RunRecord, RunSpec, Scores, TaskSpec, gather
from sprl_bench.records.folder import run_path
from sprl_bench.tasks import CUSTOM, SUITES

SHOWN_HOLES = 8


class MissingRunsError(ValueError):
    """A mean needs runs that are missing; the message names them."""


@dataclass(frozen=True)
class Result:
    """One seed of one agent on one task."""

    suite: str
    suite_version: int
    task: TaskSpec
    agent: str
    privileged: bool
    information: tuple[str, ...]  # what else the agent uses: relabelling, resetting, shaped
    seed: int
    num_envs: int
    hyperparameters: Mapping[str, JsonValue]
    fingerprint: str
    versions: Mapping[str, str]
    git_commits: tuple[str, ...]  # of this package's checkout; none for an installed wheel
    agent_codes: tuple[str, ...]  # hashes of the agent's own file, or of the script
    device: str
    torch_threads: int
    abandoned_share: float  # of the episodes: reset before their end
    return_curve: tuple[float, ...]
    success_curve: tuple[float, ...]
    scores: Scores
    episodes: int | None = None  # that ended within the budget; entries do not say

    @classmethod
    def of(cls, record: RunRecord) -> Result:
        """Return the part of a run's record that tables need."""
        return gather(cls, record, record.spec, record.totals)


@dataclass(frozen=True, order=True)
class Hole:
    """A run that a mean needs and that is missing."""

    agent: str
    task: str
    seed: int

    def __str__(self) -> str:
        """Return the run's path below its suite."""
        return str(run_path("", self.task, self.agent, self.seed))


def split_suites(results: Iterable[Result]) -> list[list[Result]]:
    """Return the results of each suite, and of each task that belongs to none, by name."""
    groups: dict[str, list[Result]] = defaultdict(list)
    for result in results:
        groups[table_of(result.suite, result.task.name)].append(result)
    return [group for _, group in sorted(groups.items())]


def table_of(suite: str, task: str) -> str:
    """Return the name of a run's table: the suite, or the task's own for one of no suite."""
    return f"{suite}/{task}" if suite == CUSTOM.name else suite


def task_names(results: Sequence[Result]) -> tuple[str, ...]:
    """Return the tasks of one suite, and any others among its results, in the suite's order."""
    suite = SUITES.get(results[0].suite)
    known = [task.name for task in suite.tasks] if suite and suite.version == results[0].suite_version else []
    return tuple(dict.fromkeys([*known, *sorted(result.task.name for result in results)]))


def find_holes(results: Sequence[Result], planned: Iterable[RunSpec], tasks: Sequence[str]) -> list[Hole]:
    """Return the runs that are missing from agents x tasks x seeds.

    An agent's seeds are those that it has on any of the tasks or that are planned.

    Args:
        results: Of one suite.
        planned: Specs of all runs that there should be, finished or not.
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
