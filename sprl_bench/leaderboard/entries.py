"""An entry of a leaderboard: every seed's scores and curves, never only a mean.

An entry checks itself: its scores follow from its curves and its hash from its hyperparameters; it has at least five
seeds, the same on all tasks, no two with the same curves. `check_entry` holds it against its suite and agent.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Annotated, Literal, Self

from pydantic import AfterValidator, Field, model_validator

from sprl_bench.records import Data, Hardware, Scores, TaskSpec, gather, hyperparameters_hash
from sprl_bench.records.types import Amount, Count, Curve, InformationClasses, Json, Line, Name, Share, check_scores
from sprl_bench.tables import SCORED_PACKAGES, Result

MINIMUM_SEEDS = 5
NEEDED_VERSIONS = ("python", "numpy", "sprl-bench")  # every run has loaded them


def _link(text: str) -> str:
    if not re.fullmatch(r"https?://[^\s/@\"'<>]+\.[^\s/@\"'<>]+(/[^\s\"'<>]*)?", text):
        raise ValueError(
            f"{text!r} is not a link: https://, or http://, then a host with a dot in it; no user, spaces, quotes or <>"
        )
    return text


def _words(text: str) -> str:
    if not text or text != text.strip():
        raise ValueError(f"{text!r} is empty or has spaces around it")
    return text


class SeedResult(Data):
    """One run."""

    seed: Count
    device: Line
    torch_threads: Annotated[int, Field(gt=0)]
    abandoned_share: Share = Field(
        default=0.0, description="Of the episodes, those that were reset before their end, which count as failures."
    )
    wall_time_s: Amount | None = Field(
        default=None, description="Seconds that the run took, on a machine that other work may have shared."
    )
    scores: Scores
    return_curve: Curve
    success_curve: Curve


class TaskEntry(Data):
    """All runs of one task: what they had in common, and each on its own."""

    task: TaskSpec
    source: Line = Field(description='Entry point or "package.module:attribute"; empty for a recorded script.')
    hyperparameters: dict[Line, Json]
    hyperparameters_hash: Line
    num_envs: Annotated[int, Field(gt=0)]
    fingerprint: Annotated[str, Field(pattern="^[0-9a-f]{16}$")] = Field(
        description="Of the environment: the hash of a fixed trajectory."
    )
    versions: dict[Line, Line] = Field(
        default_factory=dict, description="Of this task's runs, where those of all tasks are not the same."
    )
    results: tuple[SeedResult, ...]

    @property
    def seeds(self) -> tuple[int, ...]:
        """The seeds, in ascending order."""
        return tuple(result.seed for result in self.results)

    @model_validator(mode="after")
    def _holds_together(self) -> Self:
        if self.hyperparameters_hash != hyperparameters_hash(self.hyperparameters):
            raise ValueError("hyperparameters_hash does not follow from hyperparameters")
        if list(self.seeds) != sorted(set(self.seeds)):
            raise ValueError(f"results has the seeds {list(self.seeds)}; each once, in ascending order")
        if len(self.seeds) < MINIMUM_SEEDS:
            raise ValueError(f"results has {len(self.seeds)} of at least {MINIMUM_SEEDS} seeds")
        for number, result in enumerate(self.results):
            try:
                self._check_result(result)
            except ValueError as error:
                raise ValueError(f"results[{number}].{error}") from None
        self._check_distinct()
        return self

    def _check_distinct(self) -> None:
        """Refuse the curves of one run under two seeds."""
        seen: dict[tuple[Curve, Curve], int] = {}
        for number, result in enumerate(self.results):
            curves = result.return_curve, result.success_curve
            if not is_telling(self.task, result.return_curve):
                continue
            if curves in seen:
                raise ValueError(
                    f"results[{number}].seed is {result.seed}, but its curves are those of seed {seen[curves]}: each "
                    "seed needs a run of its own"
                )
            seen[curves] = result.seed

    def _check_result(self, result: SeedResult) -> None:
        low, high = self.task.score_range
        _check_range("return_curve", result.return_curve, min(low, 0.0), max(high, 0.0))
        _check_range("success_curve", result.success_curve, 0.0, 1.0)
        check_scores(self.task, result.return_curve, result.success_curve, result.scores)


def is_telling(task: TaskSpec, return_curve: Curve) -> bool:
    """Return whether two runs can hardly share this curve: it has more values than 0 and the ends of the range."""
    values = set(return_curve)
    return len(values) > 1 and not values <= {0.0, *task.score_range}


def _check_range(name: str, curve: Sequence[float], low: float, high: float) -> None:
    """Refuse a bin outside the range of returns; bins before the first episode are 0."""
    slack = 1e-9 * (high - low)  # a mean may leave the range by the last bit
    for number, value in enumerate(curve):
        if not low - slack <= value <= high + slack:
            raise ValueError(f"{name}[{number}] is {value}, outside of [{low:g}, {high:g}]")


class Entry(Data):
    """One agent on one suite."""

    schema_version: Literal[1] = 1
    agent: Name
    authors: Annotated[tuple[Annotated[Line, AfterValidator(_words)], ...], Field(min_length=1, max_length=1000)]
    link: Annotated[Line, AfterValidator(_link)] = Field(description="A paper or the code.")
    privileged: bool = Field(description="Whether the agent sees what an ordinary one does not.")
    information: InformationClasses = ()
    status: Literal["reported", "reproduced"] = Field(description="Reproduced: run again by someone else.")
    evidence: Literal["replayed", "recorded", "reported"] = Field(
        default="recorded",
        description="Replayed: the environment alone gave every score again, by the runs' actions. Recorded: written "
        "by the recorder. Reported: copied from elsewhere.",
    )
    suite: Name
    suite_version: Count
    tasks: Annotated[tuple[TaskEntry, ...], Field(min_length=1)]
    versions: dict[Line, Line]
    git_commits: tuple[Line, ...] = Field(description="Of the checkouts of sprl-bench that the runs were made with.")
    agent_codes: tuple[Line, ...] = Field(
        default=(),
        description='Hashes of the file of an agent named as "package.module:attribute", of the sources of an '
        "installed agent's package, or of the scripts.",
    )
    hardware: Annotated[tuple[Hardware, ...], Field(min_length=1)]

    @model_validator(mode="after")
    def _same_seeds_everywhere(self) -> Self:
        names = [entry.task.name for entry in self.tasks]
        for number, entry in enumerate(self.tasks):
            if names.index(entry.task.name) != number:
                raise ValueError(f"tasks[{number}].task.name is {entry.task.name!r} for a second time")
            if entry.seeds != self.tasks[0].seeds:
                raise ValueError(
                    f"tasks[{number}].results has the seeds {list(entry.seeds)} and the first task "
                    f"{list(self.tasks[0].seeds)}; all tasks need the same"
                )
        return self

    @model_validator(mode="after")
    def _versions_are_known(self) -> Self:
        for package in NEEDED_VERSIONS:
            if package not in self.versions:
                raise ValueError(f"versions has no {package}")
        for number, task in enumerate(self.tasks):
            for package in task.versions:
                if package not in self.versions:
                    raise ValueError(f"tasks[{number}].versions has {package}, which the entry's versions lack")
            for package in SCORED_PACKAGES:
                text = self._versions_of(task).get(package, "")
                if "," in text:
                    raise ValueError(
                        f"versions.{package} is {text!r} for task {task.task.name}; its seeds have one version of it"
                    )
        return self

    def _versions_of(self, task: TaskEntry) -> dict[str, str]:
        """Return the versions of all packages that a task's runs loaded."""
        return {**self.versions, **task.versions}

    @property
    def wall_time_s(self) -> float | None:
        """Seconds of all runs together; None where one is unknown."""
        times = [result.wall_time_s for entry in self.tasks for result in entry.results]
        known = [time for time in times if time is not None]
        return sum(known) if len(known) == len(times) else None

    def results(self) -> Sequence[Result]:
        """Return one result a run, as tables take them."""
        return [
            gather(Result, self, entry, result, versions=self._versions_of(entry))
            for entry in self.tasks
            for result in entry.results
        ]
