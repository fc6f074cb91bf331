"""The types of a run's files: its spec and its record.

Plain data, checked when read: unknown keys, numbers that are not finite, and scores that do not follow from their own
curve are refused with one sentence that names the key.
"""

from __future__ import annotations

import hashlib
import json
import math
import unicodedata
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any, Final, Literal, Self, TypeVar

import numpy as np
from pydantic import AfterValidator, BeforeValidator, Field, JsonValue, ValidationError, model_validator

from sprl_bench import scores
from sprl_bench.records.files import Data, InvalidFileError, OnBroken, first_complaint, read, refuse
from sprl_bench.records.folder import RECORD, find_files, run_path
from sprl_bench.tasks import Suite, Task

SHOWN_LETTERS = 60
LIMIT: Final = 2**53  # of whole numbers: every program reads smaller ones exactly
FOLLOWING = {"preset", "differences", "hyperparameters_hash"}  # from the agent's name and all hyperparameters
LONGEST_NAME = 200  # bytes, of the 255 that a file's name may have


def _file_name(name: str) -> str:
    """Refuse a name that is no file name on some system, or a formula in a spreadsheet."""
    sound = (name[0].isalnum() or name[0] == "_") and not name.endswith(".") and name == name.strip()
    if not sound or set(name) & set('/\\:"<>|?*') or len(name.encode()) > LONGEST_NAME:
        raise ValueError(
            f"{name!r} cannot name a folder on every system: it must begin with a letter, digit or _, not end in a dot "
            f'or space, have none of / \\ : " < > | ? * and at most {LONGEST_NAME} bytes'
        )
    return name


def _printable(text: str) -> str:
    if text.isprintable():
        return text
    if not all(letter.isprintable() or unicodedata.category(letter) == "Zs" for letter in text):
        raise ValueError(f"{text!r} has a line break or another control character")
    return text


def _finite(value: JsonValue) -> JsonValue:
    try:
        json.dumps(value, allow_nan=False)
    except ValueError:
        raise ValueError(f"{value!r} is or holds a number that is not finite") from None
    return value


def _plain_integer(value: Any) -> Any:
    """Turn NumPy's integers into Python's."""
    return int(value) if isinstance(value, np.integer) else value


def _unsigned(value: float) -> float:
    """Refuse -0.0, which is not less than 0: no length and no duration has it."""
    if math.copysign(1.0, value) < 0:
        raise ValueError(f"it is {value}; it must be 0.0 or more")
    return value


Name = Annotated[
    str, Field(min_length=1, max_length=LONGEST_NAME), AfterValidator(_printable), AfterValidator(_file_name)
]
Line = Annotated[str, Field(max_length=300), AfterValidator(_printable)]
Count = Annotated[int, Field(ge=0, lt=LIMIT), BeforeValidator(_plain_integer)]
Whole = Annotated[int, Field(gt=-LIMIT, lt=LIMIT)]
Positive = Annotated[int, Field(gt=0, lt=LIMIT), BeforeValidator(_plain_integer)]
Bounded = Annotated[float, Field(ge=-1e300, le=1e300)]  # the sum of a curve is finite
Amount = Annotated[float, Field(ge=0), AfterValidator(_unsigned)]
Share = Annotated[float, Field(ge=0, le=1), AfterValidator(_unsigned)]
Information = Literal["relabelling", "resetting", "shaped"]
InformationClasses = Annotated[
    tuple[Information, ...],
    Field(
        strict=False,
        description="What else the agent uses: relabelling (rewards of goals that it did not pursue), resetting "
        "(returns to earlier states), shaped (another reward than the task's).",
    ),
]
Json = Annotated[JsonValue, AfterValidator(_finite)]
Curve = Annotated[tuple[Bounded, ...], Field(min_length=scores.BINS, max_length=scores.BINS, strict=False)]


Kind = TypeVar("Kind")
MISSING: Final = object()


def gather(kind: type[Kind], *sources: object, **others: Any) -> Kind:
    """Make a value of a dataclass or a `Data` whose fields come by name from the first source that has them.

    Args:
        kind: What to make.
        sources: Values with attributes; those that are no fields of `kind` are left out.
        others: Fields that no source has, or that are not what it has.
    """
    names = getattr(kind, "__dataclass_fields__", None) or getattr(kind, "model_fields", {})
    found = {name: value for name in names if (value := _first(name, sources)) is not MISSING}
    return kind(**{**found, **others})


def _first(name: str, sources: Sequence[object]) -> Any:
    """Return an attribute of the first source that has it."""
    return next((value for source in sources if (value := getattr(source, name, MISSING)) is not MISSING), MISSING)


class TaskSpec(Data):
    """A task as it was when the run was made."""

    name: Name
    env_id: Line
    budget: Positive
    domain: Line
    arguments: dict[Line, bool | Whole | float | Line] = Field(default_factory=dict)
    score_range: Annotated[tuple[Bounded, Bounded], Field(strict=False)] = (0.0, 1.0)

    @model_validator(mode="after")
    def _range_is_one(self) -> Self:
        low, high = self.score_range
        if low >= high:
            raise ValueError(f"score_range is [{low:g}, {high:g}]; the first must be less than the second")
        return self

    @classmethod
    def of(cls, task: Task) -> Self:
        """Return the written form of a row of the task table."""
        return gather(cls, task, arguments=dict(task.arguments))


def hyperparameters_hash(hyperparameters: Mapping[str, Any]) -> str:
    """Return 16 hexadecimal digits that depend on the names and values, not on their order."""
    text = json.dumps(hyperparameters, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def _short(value: Any) -> str:
    text = " ".join(repr(value).split())
    kind = "" if type(value) in (float, list, dict) else f" ({type(value).__module__}.{type(value).__qualname__})"
    return f"{text[:SHOWN_LETTERS]}..." * (len(text) > SHOWN_LETTERS) + text * (len(text) <= SHOWN_LETTERS) + kind


def _plain(name: Any, value: Any) -> Any:
    if not isinstance(name, str):
        raise ValueError(f"hyperparameters: the name {name!r} is not text")
    unfit: list[Any] = []
    try:
        return json.loads(json.dumps(value, allow_nan=False, default=lambda inner: _number(inner, unfit)))
    except (TypeError, ValueError):
        inner = f", which holds {_short(unfit[0])}" if unfit and unfit[0] is not value else ""
        raise ValueError(
            f"hyperparameters: {name} is {_short(value)}{inner}; it must be plain: finite numbers, text, lists, dicts"
        ) from None


def _number(value: Any, unfit: list[Any]) -> Any:
    """Return a NumPy scalar as Python's number; note anything else as unfit."""
    if isinstance(value, np.generic):
        return value.item()
    unfit.append(value)
    raise TypeError


class RunSpec(Data):
    """A run as a value: all that its scores depend on, apart from the code and its versions."""

    suite: Name
    suite_version: Count
    task: TaskSpec
    agent: Name
    source: Line = Field(description='Entry point or "package.module:attribute"; empty for a recorded script.')
    preset: Line = Field(default="", description="That the hyperparameters come from; empty where there is none.")
    differences: dict[Line, Json] = Field(
        default_factory=dict, description="The hyperparameters that differ from the preset; num_envs may be among them."
    )
    privileged: bool
    information: InformationClasses = ()
    hyperparameters: dict[Line, Json]
    hyperparameters_hash: Line
    seed: Count
    num_envs: Positive
    observation: Line = Field(
        default="",
        description="The form in which the agent saw the environment, empty for the usual one. Runs in all forms of a "
        "task are compared.",
    )
    device: Line = "cpu"
    torch_threads: Positive = 1

    @model_validator(mode="after")
    def _hash_agrees(self) -> Self:
        if self.hyperparameters_hash != hyperparameters_hash(self.hyperparameters):
            raise ValueError("hyperparameters_hash does not follow from hyperparameters")
        return self

    @model_validator(mode="after")
    def _differences_agree(self) -> Self:
        resolved = {"num_envs": self.num_envs, **self.hyperparameters}
        for name, value in self.differences.items():
            if name not in resolved or resolved[name] != value:
                raise ValueError(f"differences.{name} is {value!r}, but the run has {resolved.get(name)!r}")
        return self

    @classmethod
    def of(
        cls,
        suite: Suite,
        task: Task,
        *,
        hyperparameters: Mapping[str, Any],
        differences: Mapping[str, Any] = MappingProxyType({}),
        **rest: Any,
    ) -> Self:
        """Return the spec of a run of one task of a suite; `rest` holds the other fields.

        Raises:
            ValueError: A field has a value that is not allowed; the message is one line that names it.
        """
        try:
            plain = {name: _plain(name, value) for name, value in hyperparameters.items()}
            return cls(
                suite=suite.name,
                suite_version=suite.version,
                task=TaskSpec.of(task),
                hyperparameters=plain,
                hyperparameters_hash=hyperparameters_hash(plain),
                differences={name: _plain(name, value) for name, value in differences.items()},
                **rest,
            )
        except ValidationError as error:
            raise ValueError(first_complaint(error)) from None

    def path(self, root: Path) -> Path:
        """Return the folder of this run under `root`."""
        return root / run_path(self.suite, self.task.name, self.agent, self.seed)


def differences(on_disk: RunSpec, now: RunSpec) -> list[str]:
    """Return a line for each field, hyperparameter or argument that differs, such as "seed: 0 on disk, 1 now"."""
    old, new = (_flat(spec.model_dump(mode="json", exclude=FOLLOWING)) for spec in (on_disk, now))
    names = [*{**old, **new}]
    changes = [
        f"{name.removeprefix('hyperparameters.')}: {old.get(name, 'absent')!r} on disk, {new.get(name, 'absent')!r} now"
        for name in names
        if old.get(name, "absent") != new.get(name, "absent")
    ]
    return list(dict.fromkeys(changes))  # num_envs may be a field and a hyperparameter


def _flat(tree: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    flat: dict[str, Any] = {}
    for name, value in tree.items():
        flat |= _flat(value, f"{prefix}{name}.") if isinstance(value, Mapping) else {prefix + name: value}
    return flat


class Scores(Data):
    """What a run's two curves come to; a function of them."""

    auc: Bounded
    final: Bounded
    success_auc: Bounded
    success_final: Bounded
    steps_to_threshold: Count | None = Field(description="Environment steps; null where it was never reached.")

    @classmethod
    def of(cls, task: TaskSpec, return_curve: Sequence[float], success_curve: Sequence[float]) -> Self:
        """Compute the scores of a run of `task`."""
        returns, success = np.asarray(return_curve), np.asarray(success_curve)
        return cls(
            auc=scores.auc(returns),
            final=scores.final(returns),
            success_auc=scores.auc(success),
            success_final=scores.final(success),
            steps_to_threshold=scores.steps_to_threshold(returns, task.budget, task.score_range),
        )


class Totals(Data):
    """Counts over the whole run, up to the budget."""

    env_steps: Count
    episodes: Count
    abandoned: Count = Field(
        default=0, description="Episodes that the agent reset before their end; they count as failures."
    )
    successes: Count
    mean_return: Bounded = Field(description="Over all scored episodes; 0 where there is none.")
    mean_length: Amount = Field(description="In environment steps; 0 where there is none.")

    @property
    def abandoned_share(self) -> float:
        """Share of the episodes that were reset before their end."""
        return min(1.0, self.abandoned / self.episodes) if self.episodes else 0.0

    @model_validator(mode="after")
    def _parts_are_no_more_than_all(self) -> Self:
        if self.successes > self.episodes:
            raise ValueError(f"successes is {self.successes}, but there are {self.episodes} episodes")
        return self


class Hardware(Data):
    """The machine; of two with the same kind of processor, no score depends on it on a CPU."""

    cpu: Line
    cores: Count
    memory_gib: Amount
    gpu: Line | None = None


class RunRecord(Data):
    """One run: its spec, its scores, and its provenance."""

    schema_version: Literal[1] = 1
    spec: RunSpec
    status: Literal["complete", "incomplete"]
    return_curve: Curve
    success_curve: Curve
    scores: Scores
    totals: Totals
    fingerprint: Line = Field(description="Of the environment: the hash of a fixed trajectory.")
    versions: dict[Line, Line]
    git_commit: Line | None
    agent_code: Line | None = Field(
        default=None,
        description='Hash of the file of an agent named as "package.module:attribute", of the sources of an installed '
        "agent's package, or of the script.",
    )
    hardware: Hardware
    wall_time_s: Amount
    peak_memory_mib: Amount

    @property
    def git_commits(self) -> tuple[str, ...]:
        """The commit as an entry lists it; none for an installed wheel."""
        return (self.git_commit,) if self.git_commit else ()

    @property
    def agent_codes(self) -> tuple[str, ...]:
        """The hash of the agent's own file as an entry lists it; none for an installed agent."""
        return (self.agent_code,) if self.agent_code else ()

    @model_validator(mode="after")
    def _scores_follow(self) -> Self:
        check_scores(self.spec.task, self.return_curve, self.success_curve, self.scores)
        return self

    @model_validator(mode="after")
    def _totals_agree(self) -> Self:
        steps, budget = self.totals.env_steps, self.spec.task.budget
        if steps > budget or (steps == budget) != (self.status == "complete"):
            raise ValueError(f"totals.env_steps is {steps} of a budget of {budget}, and status {self.status!r}")
        return self


def check_scores(task: TaskSpec, return_curve: Sequence[float], success_curve: Sequence[float], scores: Scores) -> None:
    """Check that scores follow from their curves.

    Raises:
        ValueError: One does not.
    """
    for name, expected in Scores.of(task, return_curve, success_curve):
        if getattr(scores, name) != expected:
            raise ValueError(f"scores.{name} is {getattr(scores, name)} but its curve gives {expected}")


def find_records(root: str | Path) -> list[RunRecord]:
    """Read all records below `root`, in the order of their paths.

    Raises:
        InvalidFileError: One of them is broken.
        FileNotFoundError: There is no such folder.
    """
    return [record for _, record in find_recorded(root)]


def find_recorded(root: str | Path, on_broken: OnBroken = refuse) -> list[tuple[Path, RunRecord]]:
    """Return the folder and the record of each run that has one, as `find_records` does.

    Args:
        root: The folder of all runs.
        on_broken: Receives each run that cannot be read, which is then left out; by default it raises the error.
    """
    root = Path(root)
    if not root.exists():
        raise FileNotFoundError(f"{root} does not exist.")
    found = []
    for path in find_files(root, RECORD, lambda error: on_broken(Path(error.filename), error)):
        try:
            found.append((path.parent, read(path, RunRecord)))
        except (InvalidFileError, OSError) as error:
            on_broken(path.parent, error)
    return found
