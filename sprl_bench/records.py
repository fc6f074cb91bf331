"""The types of what is written to disk: one run's record, and what it was a run of.

Plain data, checked when read: unknown keys, numbers that are not finite, and scores that do not follow from their own
curve are refused with one line that names the place.
"""

from __future__ import annotations

import hashlib
import json
import os
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal, Self, TypeVar

import numpy as np
from pydantic import AfterValidator, BaseModel, ConfigDict, Field, JsonValue, ValidationError, model_validator

from sprl_bench import metrics
from sprl_bench.tasks import Suite, Task

__all__ = [
    "Curve",
    "Hardware",
    "InvalidFileError",
    "RunRecord",
    "RunSpec",
    "Scores",
    "TaskSpec",
    "Totals",
    "find_records",
    "hyperparameters_hash",
    "read",
    "write",
]


class Data(BaseModel):
    """Immutable, strict about names and types, finite numbers only."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, strict=True)


def _file_name(name: str) -> str:
    if not name or name.startswith(".") or any(letter in name for letter in '/\\:\0\n"'):
        raise ValueError(f"{name!r} cannot name a folder: no slashes, colons or quotes, and no dot in front")
    return name


Name = Annotated[str, AfterValidator(_file_name), Field(max_length=100)]
Curve = Annotated[tuple[float, ...], Field(min_length=metrics.BINS, max_length=metrics.BINS, strict=False)]


class TaskSpec(Data):
    """A task as it was when the run was made."""

    name: Name
    env_id: str
    budget: Annotated[int, Field(gt=0)]
    domain: str
    arguments: dict[str, bool | int | float | str] = {}
    score_range: Annotated[tuple[float, float], Field(strict=False)] = (0.0, 1.0)

    @classmethod
    def of(cls, task: Task) -> Self:
        """Return the written form of a row of the task table."""
        return cls(
            name=task.name,
            env_id=task.env_id,
            budget=task.budget,
            domain=task.domain,
            arguments=dict(task.arguments),
            score_range=task.score_range,
        )


def hyperparameters_hash(hyperparameters: Mapping[str, Any]) -> str:
    """Return 16 hexadecimal digits that follow from the names and values alone, whatever their order."""
    text = json.dumps(hyperparameters, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()[:16]


class RunSpec(Data):
    """A run as a value: all that its scores follow from, apart from the code and its versions."""

    suite: Name
    suite_version: Annotated[int, Field(ge=0)]
    task: TaskSpec
    agent: Name
    source: str = Field(description='Entry point or "package.module:attribute"; empty for a recorded script.')
    privileged: bool
    hyperparameters: dict[str, JsonValue]
    hyperparameters_hash: str
    seed: Annotated[int, Field(ge=0)]
    num_envs: Annotated[int, Field(gt=0)]
    device: str = "cpu"
    torch_threads: Annotated[int, Field(gt=0)] = 1

    @model_validator(mode="after")
    def _hash_agrees(self) -> Self:
        if self.hyperparameters_hash != hyperparameters_hash(self.hyperparameters):
            raise ValueError("hyperparameters_hash does not follow from hyperparameters")
        return self

    @classmethod
    def of(cls, suite: Suite, task: Task, *, hyperparameters: Mapping[str, Any], **rest: Any) -> Self:
        """Return the spec of a run of one task of a suite; `rest` are the other fields."""
        return cls(
            suite=suite.name,
            suite_version=suite.version,
            task=TaskSpec.of(task),
            hyperparameters=dict(hyperparameters),
            hyperparameters_hash=hyperparameters_hash(hyperparameters),
            **rest,
        )

    def path(self, root: Path) -> Path:
        """Return the folder of this run under `root`."""
        return root / self.suite / self.task.name / self.agent / f"seed-{self.seed}"


class Scores(Data):
    """What a run's two curves come to; a function of them."""

    auc: float
    final: float
    success_auc: float
    success_final: float
    steps_to_threshold: int | None = Field(description="Environment steps; null where it was never reached.")

    @classmethod
    def of(cls, task: TaskSpec, return_curve: tuple[float, ...], success_curve: tuple[float, ...]) -> Self:
        """Compute the scores of a run of `task`."""
        returns, success = np.asarray(return_curve), np.asarray(success_curve)
        return cls(
            auc=metrics.auc(returns),
            final=metrics.final(returns),
            success_auc=metrics.auc(success),
            success_final=metrics.final(success),
            steps_to_threshold=metrics.steps_to_threshold(returns, task.budget, task.score_range),
        )


class Totals(Data):
    """Counts over the whole run, up to the budget."""

    env_steps: Annotated[int, Field(ge=0)]
    episodes: Annotated[int, Field(ge=0)]
    successes: Annotated[int, Field(ge=0)]
    mean_return: float = Field(description="Over all scored episodes; 0 where there is none.")
    mean_length: float = Field(description="In environment steps; 0 where there is none.")


class Hardware(Data):
    """The machine; no score depends on it on a CPU."""

    cpu: str
    cores: int
    memory_gib: float
    gpu: str | None = None


class RunRecord(Data):
    """One run: what it was, what came of it, and what it ran on."""

    schema_version: Literal[1] = 1
    spec: RunSpec
    status: Literal["complete", "incomplete"]
    return_curve: Curve
    success_curve: Curve
    scores: Scores
    totals: Totals
    fingerprint: str = Field(description="Of the environment: a golden trajectory's hash.")
    versions: dict[str, str]
    git_commit: str | None
    hardware: Hardware
    wall_time_s: Annotated[float, Field(ge=0)]
    peak_memory_mib: Annotated[float, Field(ge=0)]

    @model_validator(mode="after")
    def _scores_follow(self) -> Self:
        expected = Scores.of(self.spec.task, self.return_curve, self.success_curve)
        for name, value in expected:
            if getattr(self.scores, name) != value:
                raise ValueError(f"scores.{name} is {getattr(self.scores, name)} but its curve gives {value}")
        return self


class InvalidFileError(ValueError):
    """A file that does not hold what it should; the message names the file and the first place."""


Model = TypeVar("Model", bound=Data)


def read(path: Path, model: type[Model]) -> Model:
    """Read and check one JSON file.

    Raises:
        InvalidFileError: It is truncated, has an unknown or missing key, a wrong type, or a number that is not finite.
        FileNotFoundError: There is no such file.
    """
    try:
        return model.model_validate_json(path.read_bytes())
    except ValidationError as error:
        first = error.errors(include_url=False, include_input=False)[0]
        place = ".".join(str(part) for part in first["loc"]) or "the file"
        more = f" (and {error.error_count() - 1} more)" if error.error_count() > 1 else ""
        raise InvalidFileError(f"{path}: {place}: {first['msg']}{more}") from None


def find_records(root: Path) -> list[RunRecord]:
    """Read all records below `root`, in the order of their paths.

    Raises:
        InvalidFileError: One of them is broken.
        FileNotFoundError: There is no such folder.
    """
    if not root.exists():
        raise FileNotFoundError(f"{root} does not exist.")
    return [read(path, RunRecord) for path in sorted(root.rglob("record.json"))]


def write(path: Path, data: Data) -> None:
    """Write one JSON file so that `path` holds either what it held before or all of `data`."""
    write_bytes(path, (data.model_dump_json(indent=1) + "\n").encode())


def write_bytes(path: Path, content: bytes) -> None:
    """Write a temporary file beside `path`, flush it to the disk, and rename it."""
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        Path(temporary).replace(path)
    except BaseException:
        Path(temporary).unlink(missing_ok=True)
        raise
