"""Which numbers of a table are the best of their column, or not significantly worse."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from sprl_bench import scores
from sprl_bench.tables.table import BOOTSTRAP_SEED, Estimate, Row, Table

BOLD = "Bold: the best without privileged information, and all whose difference from it is not significant (95 %)."


def leaders_of(table: Table) -> set[tuple[int, int]]:
    """Return the row and the column, from 0, of each leading number; columns are the tasks and the overall figures.

    Privileged agents do not take part.
    """
    return {
        (row, place)
        for place, column in enumerate(_columns(table))
        for row in _leading(column, _statistic(place, table))
    }


def _columns(table: Table) -> Iterator[list[Estimate | None]]:
    """Yield each column's numbers, None for privileged agents and where there is none."""
    for numbers in zip(*map(_numbers, table.rows), strict=True):
        yield [None if row.privileged else one for row, one in zip(table.rows, numbers, strict=True)]


def _numbers(row: Row) -> Sequence[Estimate | None]:
    return *(cell.auc for cell in row.cells), row.auc, row.auc_iqm, row.final, row.success_final


def _statistic(place: int, table: Table) -> scores.Statistic:
    return scores.iqm if place == len(table.tasks) + 1 else scores.mean


def _leading(column: Sequence[Estimate | None], statistic: scores.Statistic) -> Iterator[int]:
    there = {row: one for row, one in enumerate(column) if one is not None}
    if not there:
        return
    best = max(there.values(), key=lambda one: one.value)
    for row, one in there.items():
        if one.value == best.value or not _is_worse(one, best, statistic):
            yield row


def _is_worse(one: Estimate, best: Estimate, statistic: scores.Statistic) -> bool:
    """Return whether the interval of the difference excludes 0; a single seed has none, and counts as worse."""
    generator = np.random.default_rng(BOOTSTRAP_SEED)
    ours, theirs = np.asarray(best.values), np.asarray(one.values)
    interval = scores.difference_interval(ours, theirs, generator, statistic=statistic)
    return interval is None or interval.low > 0
