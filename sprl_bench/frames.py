"""Results as pandas data frames: what was recorded, to compute with and to draw.

Every frame is indexed, and sorted, by what names a run: `suite`, `task`, `agent` and `seed`. Text is of pandas'
`string` type, whole numbers are `int64` (`Int64` where one may be missing), other numbers `float64`. Nothing here
writes a file. pandas comes with the extra `plots`, and is loaded when a frame is made.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Final

from sprl_bench import leaderboard, scores
from sprl_bench.extras import require_extra
from sprl_bench.records import RunRecord, RunSpec, find_metrics, find_recorded, find_records
from sprl_bench.records.folder import EPISODES
from sprl_bench.tables import Result
from sprl_bench.tasks import ORACLES, REFERENCES

if TYPE_CHECKING:  # the extra `plots`
    from pandas import DataFrame

INDEX: Final = ("suite", "task", "agent", "seed")
SPEC_COLUMNS: Final = ("preset", "privileged", "num_envs", "observation", "device", "torch_threads")
RECORD_COLUMNS: Final = ("fingerprint", "git_commit", "wall_time_s", "peak_memory_mib")
TEXT: Final = "string[python]"
NULLABLE: Final = MappingProxyType({bool: "boolean", float: "Float64", int: "Int64", str: TEXT})


def runs(root: str | Path) -> DataFrame:
    """Return one row a run, finished or not.

    Columns: `status`, `budget`, `preset`, `privileged`, `num_envs`, `observation`, `device`, `torch_threads`,
    `differences` (from the preset, as JSON); the scores `auc`, `final`, `success_auc`, `success_final` and
    `steps_to_threshold`; the totals `env_steps`, `episodes`, `abandoned`, `successes`, `mean_return` and `mean_length`;
    `fingerprint`, `git_commit`, `wall_time_s`, `peak_memory_mib` and `cpu`.

    Args:
        root: The folder of all runs.

    Raises:
        FileNotFoundError: There is no such folder.
        ModuleNotFoundError: pandas is not installed.
        ValueError: The folder has no run.
    """
    return _frame(_run_row(record) for record in find_records(Path(root)))


def human_normalized(root: str | Path) -> DataFrame:
    """Return one row a run of an Atari game: its scores on a scale of 0 for random and 1 for human play.

    Columns: `auc` and `final`. The references are those of `sprl_bench.tasks.REFERENCES`, of which every environment
    has its own. The argument and the errors are those of `runs`.
    """
    known = [one for one in find_records(Path(root)) if one.spec.task.env_id in REFERENCES]
    return _frame({**_key(one.spec), **_shares(one, REFERENCES[one.spec.task.env_id])} for one in known)


def _shares(record: RunRecord, reference: tuple[float, float]) -> dict[str, float]:
    return {name: float(scores.normalized(getattr(record.scores, name), reference)) for name in ("auc", "final")}


def oracle_normalized(root: str | Path) -> DataFrame:
    """Return one row a run on a grid or in a maze: its scores on a scale of 0 for nothing and 1 for the solver.

    Columns: `auc` and `final`, divided by the solver's mean return, `sprl_bench.tasks.ORACLES`. The argument and the
    errors are those of `runs`.
    """
    known = [one for one in find_records(Path(root)) if one.spec.task.env_id in ORACLES]
    return _frame({**_key(one.spec), **_shares(one, (0.0, ORACLES[one.spec.task.env_id]))} for one in known)


def hyperparameters(root: str | Path) -> DataFrame:
    """Return one row a run and one column a hyperparameter, missing where an agent has none of that name.

    A column has pandas' nullable type for its values: `Int64`, `Float64`, `boolean` or `string`; `object` where they
    are mixed. The argument and the errors are those of `runs`.
    """
    records = find_records(Path(root))
    frame = _frame({**_key(one.spec), **one.spec.hyperparameters} for one in records)
    values = {name: [one.spec.hyperparameters.get(str(name)) for one in records] for name in frame.columns}
    return frame.astype({name: _nullable(column) for name, column in values.items()})


def _nullable(values: Iterable[object]) -> str:
    """Return pandas' nullable type for these values, of which some may be None."""
    kinds = {type(value) for value in values} - {type(None)}
    return NULLABLE.get(kinds.pop(), "object") if len(kinds) == 1 else "object"


def curves(root: str | Path) -> DataFrame:
    """Return the learning curves of the finished runs in long form: 100 rows a run.

    Columns: `env_steps`, where the bin ends; `return` and `success`, the means of the episodes that ended in it. The
    argument and the errors are those of `runs`.
    """
    records = find_records(Path(root))
    return _frame(row for one in records if one.status == "complete" for row in _curve_rows(Result.of(one)))


def episodes(root: str | Path) -> DataFrame:
    """Return one row for each scored episode, in the order in which the episodes of a run ended.

    Columns: `stamp`, the env step with which it ended; `env`, its sub-environment; `return`; `length` in env steps;
    `success`. The argument and the errors are those of `runs`.
    """
    from pyarrow import parquet  # noqa: PLC0415 - slow to load

    recorded = [(folder, one) for folder, one in find_recorded(Path(root)) if (folder / EPISODES).exists()]
    return _joined([(one.spec, parquet.read_table(folder / EPISODES).to_pandas()) for folder, one in recorded])


def metrics(root: str | Path) -> DataFrame:
    """Return one row for each line of diagnostics: what the agent of a run logged after each update.

    Columns: `env_steps`, `wall_time_s`, `return` and `success` of the episodes that ended since the line before, and
    what the agents log, missing where one does not log it; all but `env_steps` are `float64`. Runs that are not
    finished are there, too. The argument and the errors are those of `runs`.
    """
    frame = _joined([(spec, require_extra("pandas").DataFrame(lines)) for spec, lines in find_metrics(Path(root))])
    return frame.astype({name: "int64" if name == "env_steps" else "float64" for name in frame.columns})


def board(suite: str, home: str | Path | None = None) -> DataFrame:
    """Return one row for each seed and task of a board's entries: its scores.

    Columns: `privileged`, `num_envs`, `auc`, `final`, `success_auc`, `success_final`, `steps_to_threshold`.

    Args:
        suite: The board's name.
        home: The folder of all boards; by default the published ones.

    Raises:
        FileNotFoundError: There is no such board.
        ModuleNotFoundError: pandas is not installed.
        ValueError: It has no entry.
    """
    return _frame(
        {**_key(one), "privileged": one.privileged, "num_envs": one.num_envs, **one.scores.model_dump()}
        for one in _board_results(suite, home)
    )


def board_curves(suite: str, home: str | Path | None = None) -> DataFrame:
    """Return the learning curves of a board's entries in long form, as `curves` does.

    The arguments and the errors are those of `board`.
    """
    return _frame(row for one in _board_results(suite, home) for row in _curve_rows(one))


def _board_results(suite: str, home: str | Path | None) -> list[Result]:
    folder = Path(home) if home is not None else leaderboard.home()
    return [result for entry in leaderboard.find_entries(folder / suite) for result in entry.results()]


def _key(of: RunSpec | Result) -> dict[str, Any]:
    """Return what names a run."""
    return {"suite": of.suite, "task": of.task.name, "agent": of.agent, "seed": of.seed}


def _run_row(record: RunRecord) -> dict[str, Any]:
    spec = record.spec
    return {
        **_key(spec),
        "status": record.status,
        "budget": spec.task.budget,
        **{name: getattr(spec, name) for name in SPEC_COLUMNS},
        "differences": json.dumps(spec.differences, sort_keys=True),
        **record.scores.model_dump(),
        **record.totals.model_dump(),
        **{name: getattr(record, name) for name in RECORD_COLUMNS},
        "cpu": record.hardware.cpu,
    }


def _curve_rows(result: Result) -> Iterator[dict[str, Any]]:
    for number, values in enumerate(zip(result.return_curve, result.success_curve, strict=True), start=1):
        end = result.task.budget * number // scores.BINS
        yield {**_key(result), "env_steps": end, "return": values[0], "success": values[1]}


def _joined(parts: Sequence[tuple[RunSpec, DataFrame]]) -> DataFrame:
    """Return the frames of several runs below one another."""
    pandas = require_extra("pandas")
    frames = [part.assign(**_key(spec)) for spec, part in parts]
    return _indexed(pandas.concat(frames, ignore_index=True) if frames else pandas.DataFrame())


def _frame(rows: Iterable[Mapping[str, Any]]) -> DataFrame:
    frame: DataFrame = require_extra("pandas").DataFrame(list(rows))
    return _indexed(frame)


def _indexed(frame: DataFrame) -> DataFrame:
    """Give the columns their types, and make the index of what names a run."""
    if frame.empty:
        raise ValueError("There is nothing to make a frame of: no run, or none with the file that was asked for.")
    kinds = {name: TEXT for name in frame.columns if all(isinstance(one, str | None) for one in frame[name])}
    if "steps_to_threshold" in frame.columns:  # missing where it was never reached
        kinds["steps_to_threshold"] = "Int64"
    return frame.astype(kinds).set_index(list(INDEX)).sort_index(kind="stable")
