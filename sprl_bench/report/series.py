"""The numbers behind the charts, as plain data for JSON: each is computed where tables and pictures compute it."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Collection, Iterator, Mapping, Sequence
from itertools import combinations
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from sprl_bench import scores
from sprl_bench.plots.metrics import CLOCK, binned
from sprl_bench.records import RunSpec
from sprl_bench.report.source import Logged
from sprl_bench.tables import BOOTSTRAP_SEED, Result, Table
from sprl_bench.tables.aggregates import Improvement, improvement_of, profile_of
from sprl_bench.tables.table import MEASURES, Estimate

Numbers = list[float | None]
MOST_NUMBERS: Final = 200_000
"""Of logged metrics in a page; where there are more, means over seeds are shown, in fewer bins."""


def curves_of(results: Sequence[Result], tasks: Sequence[str]) -> list[dict[str, Any]]:
    """Return one item for each task and agent: each run's curve, and the band of their mean."""
    groups: dict[tuple[str, str], list[Result]] = defaultdict(list)
    for result in results:
        groups[result.task.name, result.agent].append(result)
    return [_curve(tasks.index(task), agent, runs) for (task, agent), runs in sorted(groups.items()) if task in tasks]


def _curve(task: int, agent: str, runs: Sequence[Result]) -> dict[str, Any]:
    curves = np.asarray([run.return_curve for run in runs])
    band = scores.curve_band(curves, np.random.default_rng(BOOTSTRAP_SEED)) or (None, None)
    digits = _digits(runs[0].task.score_range[1] - runs[0].task.score_range[0])
    low, high = (None if end is None else rounded(end, digits) for end in band)
    return {
        "task": task,
        "agent": agent,
        "seeds": [run.seed for run in runs],
        "runs": [rounded(curve, digits) for curve in curves],
        "mean": rounded(curves.mean(axis=0), digits),
        "low": low,
        "high": high,
    }


def _digits(span: float) -> int:
    """Return how many decimals show a thousandth of the span."""
    return max(0, 3 - math.floor(math.log10(span)))


def rounded(values: npt.ArrayLike, digits: int) -> Numbers:
    """Return numbers in few letters; those that are not finite are missing."""
    plain = np.asarray(values, dtype=np.float64).tolist()  # Python's own are rounded faster
    return [_short(round(value, digits)) if math.isfinite(value) else None for value in plain]


def _short(value: float) -> float:
    return int(value) if value.is_integer() else value


def estimates_of(table: Table) -> list[dict[str, Any]]:
    """Return every number of a table with its interval; the task -1 is all of them together."""
    lines = []
    for row in table.rows:
        for number, cell in enumerate(row.cells):
            lines += [_estimate(row.agent, number, name, getattr(cell, name)) for name in MEASURES]
        lines += [_estimate(row.agent, -1, name, getattr(row, name)) for name in (*MEASURES, "auc_iqm")]
    return [line for line in lines if line]


def _estimate(agent: str, task: int, measure: str, value: Estimate | None) -> dict[str, Any]:
    if value is None:
        return {}
    low, high = rounded(value.interval, 6) if value.interval else (None, None)
    return {
        "agent": agent,
        "task": task,
        "measure": measure,
        "value": round(value.value, 6),
        "low": low,
        "high": high,
        "seeds": value.seeds,
    }


def improvements_of(matrices: Mapping[str, scores.Array]) -> list[list[Any]]:
    """Return [agent, reference, probability of improvement, low, high] for every pair of agents."""
    return [line for pair in combinations(matrices, 2) for line in _improvements(improvement_of(*pair, matrices))]


def _improvements(found: Improvement) -> Iterator[list[Any]]:
    """Yield a pair's line and that of the opposite direction."""
    for one in (found, found.opposite):
        yield [one.agent, one.reference, *rounded((one.value, *(one.interval or (math.nan, math.nan))), 4)]


def profiles_of(matrices: Mapping[str, scores.Array]) -> list[dict[str, Any]]:
    """Return the performance profile of each agent: the share of runs above each threshold."""
    return [{"agent": agent, "mean": rounded(profile_of(matrix)[1], 4)} for agent, matrix in matrices.items()]


def metrics_of(logged: Sequence[Logged]) -> dict[str, Any]:
    """Return what agents logged, in bins of the budget.

    The result holds `names`; `panels`, pairs of suite and task; `bins`; `means_only`, whether single runs are left out;
    and `lines`, one for each metric, panel and agent that has it.
    """
    names = sorted({name for _, lines in logged for name in _numbers_of(lines)} - {*CLOCK})
    panels = sorted({(spec.suite, spec.task.name) for spec, _ in logged})
    budgets = {(spec.suite, spec.task.name): spec.task.budget for spec, _ in logged}
    groups: dict[tuple[int, str], list[Logged]] = defaultdict(list)
    for spec, lines in logged:
        groups[panels.index((spec.suite, spec.task.name)), spec.agent].append((spec, lines))
    bins, means_only = _resolution(len(names), len(logged), len(groups))
    return {
        "names": names,
        "panels": [{"suite": suite, "task": task, "budget": budgets[suite, task]} for suite, task in panels],
        "bins": bins,
        "means_only": means_only,
        "lines": [
            line
            for number, name in enumerate(names)
            for (panel, agent), runs in sorted(groups.items(), key=lambda item: item[0])
            if (line := _metric(runs, name, bins, means_only, metric=number, panel=panel, agent=agent))
        ],
    }


def _numbers_of(lines: Sequence[Mapping[str, Any]]) -> set[str]:
    """Return the names that have a number in some line."""
    names = set[str]().union(*lines)
    return {name for name in names if any(_is_number(line.get(name)) for line in lines)}


def _is_number(value: object) -> bool:
    return isinstance(value, int | float)


def _resolution(metrics: int, runs: int, groups: int) -> tuple[int, bool]:
    """Return how many bins a line may have, and whether single runs must be left out."""
    if metrics * runs * scores.BINS <= MOST_NUMBERS:
        return scores.BINS, False
    fitting = [bins for bins in (100, 50, 25, 10) if metrics * groups * bins <= MOST_NUMBERS]
    return fitting[0] if fitting else 5, True


def _metric(
    runs: Collection[Logged], name: str, bins: int, means_only: bool, **place: int | str
) -> dict[str, Any] | None:
    found = {spec.seed: _coarse(spec, lines, name, bins) for spec, lines in runs}
    there = {seed: values for seed, values in found.items() if not np.isnan(values).all()}
    if not there:
        return None
    single = {} if means_only else there
    return {
        **place,
        "seeds": list(single),
        "runs": [_significant(values) for values in single.values()],
        "mean": _significant(_mean(np.array(list(there.values())))),
    }


def _coarse(spec: RunSpec, lines: Sequence[Mapping[str, Any]], name: str, bins: int) -> scores.Array:
    """Return the mean of a metric in each of `bins` bins, NaN where there is none: [bins]."""
    numbers = [line for line in lines if _is_number(line.get(name))]
    _, values = binned(spec, numbers, name)
    return _mean(values.reshape(bins, -1).T)


def _mean(values: scores.Array) -> scores.Array:
    """Return the mean over the first axis, of what is there."""
    known = ~np.isnan(values)
    counts = known.sum(axis=0)
    sums = np.where(known, values, 0.0).sum(axis=0)
    return np.asarray(np.divide(sums, counts, out=np.full(counts.shape, np.nan), where=counts > 0))


def _significant(values: scores.Array) -> Numbers:
    """Return numbers with four significant digits."""
    return [_short(float(f"{value:.4g}")) if math.isfinite(value) else None for value in values.tolist()]


def seeds_of(results: Sequence[Result]) -> list[list[Any]]:
    """Return the scores of every run, one line each: see `SEED_COLUMNS`."""
    return [
        [one.suite, one.task.name, one.agent, one.seed, *(_score(value) for _, value in one.scores)]
        for one in sorted(results, key=lambda one: (one.suite, one.task.name, one.agent, one.seed))
    ]


def _score(value: float | None) -> float | None:
    return None if value is None else _short(round(float(value), 6))


SEED_COLUMNS: Final = (
    "suite",
    "task",
    "agent",
    "seed",
    "auc",
    "final",
    "success_auc",
    "success_final",
    "steps_to_threshold",
)
