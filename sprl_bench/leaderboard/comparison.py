"""A new method's runs against the entries of a board: the difference of mean AUC, paired by task."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from sprl_bench import scores
from sprl_bench.extras import require_extra
from sprl_bench.leaderboard.entries import Entry, is_telling
from sprl_bench.leaderboard.same_tasks import runs_for_board
from sprl_bench.permutation import permutation_p
from sprl_bench.records import Data, RunRecord, RunSpec, Scores
from sprl_bench.suggestions import unknown
from sprl_bench.tables import (
    BOOTSTRAP_SEED,
    IncomparableError,
    MissingRunsError,
    Result,
    check_comparable,
    describe_holes,
    find_holes,
    matrix,
)
from sprl_bench.tables.drops import drops_line
from sprl_bench.tables.render import explained, interval_text, marked
from sprl_bench.tables.text_table import GRID_FORMATS, Grid, as_json, draw, number

if TYPE_CHECKING:  # the extra `plots`
    from pandas import DataFrame

COMPARISON_FORMATS = (*GRID_FORMATS, "json")
P_VALUE = (
    "p: two-sided permutation test, stratified by task. Percentage: probability of improvement, that a run scores "
    "higher than a run of the entry."
)
SINGLE = "A single seed has no interval (-)."
IMPROVEMENT_ENDS = ("improvement_low", "improvement_high")
Columns = Mapping[str, Mapping[int, Scores]]


class Difference(Data):
    """The AUC of the runs, of the entry, and the first minus the second: means, or IQMs.

    Attributes:
        task: Its name, or "all".
        runs: Of the runs.
        entry: Of the entry.
        difference: The first minus the second.
        interval: 95 %, stratified bootstrap; None for a single seed.
        p_value: Of a two-sided permutation test, stratified by task.
        improvement: The probability that a run scores higher than a run of the entry, on a task drawn at random.
        improvement_interval: 95 %, stratified bootstrap; None for a single seed.
    """

    task: str
    runs: float
    entry: float
    difference: float
    interval: scores.Interval | None
    p_value: float
    improvement: float
    improvement_interval: scores.Interval | None


class Comparison(Data):
    """One agent's runs against one entry."""

    suite: str
    suite_version: int
    agent: str
    privileged: bool
    information: tuple[str, ...] = ()
    seeds: int
    entry: str
    entry_privileged: bool
    entry_information: tuple[str, ...] = ()
    entry_seeds: int
    tasks: tuple[Difference, ...]
    overall: Difference
    overall_iqm: Difference
    notes: tuple[str, ...]

    def to_frame(self) -> DataFrame:
        """Return the differences as a pandas data frame: one row a task, then "all" (means) and "all, IQM".

        It is indexed by `agent`, `entry` and `task`. Columns: `runs` and `entry_auc`, the two AUCs; `difference`, `low`
        and `high`, its 95 % interval, missing for a single seed; `p_value` of the stratified permutation test;
        `improvement`, the probability of improvement, with `improvement_low` and `improvement_high`.

        Raises:
            ModuleNotFoundError: pandas, of the extra `plots`, is not installed.
        """
        named = [*((one.task, one) for one in self.tasks), ("all", self.overall), ("all, IQM", self.overall_iqm)]
        rows = [
            {
                "agent": self.agent,
                "entry": self.entry,
                "task": task,
                "runs": one.runs,
                "entry_auc": one.entry,
                "difference": one.difference,
                **dict(zip(("low", "high"), one.interval or (None, None), strict=True)),
                "p_value": one.p_value,
                "improvement": one.improvement,
                **dict(zip(IMPROVEMENT_ENDS, one.improvement_interval or (None, None), strict=True)),
            }
            for task, one in named
        ]
        texts = dict.fromkeys(("agent", "entry", "task"), "string[python]")
        ends = dict.fromkeys(("low", "high", *IMPROVEMENT_ENDS), "float64")
        frame: DataFrame = require_extra("pandas").DataFrame(rows)
        return frame.astype({**texts, **ends}).set_index([*texts])


def compare(
    records: Iterable[RunRecord],
    entries: Sequence[Entry],
    *,
    agent: str | None = None,
    tasks: Sequence[str] | None = None,
    planned: Iterable[RunSpec] = (),
) -> list[Comparison]:
    """Compare runs with the entries of one board.

    The agent's seeds must be the same on all tasks. The seeds of both sides are resampled independently, within each
    task.

    Args:
        records: Finished runs; incomplete ones count as missing.
        entries: Of one suite.
        agent: The agent to compare, or None for all.
        tasks: The tasks to compare, or None for all that the agent has runs of.
        planned: Specs of all runs that there should be: those without a record count as missing.

    Raises:
        MissingRunsError: Runs are missing.
        IncomparableError: No entry is comparable with an agent's runs. Where some are, notes name the others.
        ValueError: There is no such agent or task, or nothing to compare.
    """
    if not entries:
        raise ValueError("There is no entry to compare with.")
    suite = entries[0].suite
    mine, own_plans, moved = runs_for_board(entries[0], records, planned, agent)
    complete = [Result.of(record) for record in mine if record.status == "complete"]
    names = sorted({result.agent for result in complete})
    if not names:
        raise ValueError(f"There is no finished run of suite {suite!r} to compare.")
    if agent is not None and agent not in names:
        raise ValueError(unknown("agent among these runs:", agent, names))
    for task in tasks or ():
        if task not in (allowed := [part.task.name for part in entries[0].tasks]):
            raise ValueError(unknown(f"task of suite {suite!r}", task, allowed))
    wanted = [*own_plans, *(record.spec for record in mine)]
    compared = [
        one
        for name in names
        if agent in (None, name)
        for results in [[result for result in complete if result.agent == name]]
        for one in _comparable(results, entries, tasks, [spec for spec in wanted if spec.agent == name])
    ]
    return [one.model_copy(update={"notes": (*one.notes, *moved)}) for one in compared]


def _comparable(
    results: Sequence[Result], entries: Sequence[Entry], tasks: Sequence[str] | None, planned: Sequence[RunSpec]
) -> list[Comparison]:
    """Compare one agent's runs with the entries; those that are not comparable are left out and named.

    Raises:
        IncomparableError: No entry is comparable.
    """
    found, errors = [], {}
    for entry in entries:
        try:
            found.append(_compare(results, entry, tasks, planned))
        except IncomparableError as error:
            errors[entry.agent] = error
    if not found:
        raise next(iter(errors.values()))
    left_out = [f"{name}'s entry is left out as incomparable: {error}" for name, error in errors.items()]
    return [one.model_copy(update={"notes": (*one.notes, *left_out)}) for one in found]


def side_by_side(
    entries: Sequence[Entry],
    records: Iterable[RunRecord] = (),
    *,
    planned: Iterable[RunSpec] = (),
    agents: Sequence[str] | None = None,
) -> tuple[list[Result], list[RunSpec]]:
    """Return the results of a board's entries and of finished runs of its suite, and the specs of all these runs.

    Runs of an agent that has an entry are renamed, as in "ppo of the runs". The arguments are those of `compare`;
    `agents` chooses among entries and runs alike.

    Raises:
        ValueError: There is no entry, or no such agent.
    """
    if not entries:
        raise ValueError("This board has no entry yet.")
    entered = {entry.agent for entry in entries}
    own, own_plans, _ = runs_for_board(entries[0], records, planned)
    wanted = [*own_plans, *(record.spec for record in own)]
    names = entered | {spec.agent for spec in wanted}
    for agent in agents or ():
        if agent not in names:
            raise ValueError(unknown("agent among these entries and runs:", agent, names))
    chosen = names if agents is None else set(agents)
    named = {agent: f"{agent} of the runs" if agent in entered else agent for agent in names}
    results = [Result.of(record) for record in own if record.status == "complete"]
    return (
        [
            *(result for entry in entries for result in entry.results() if result.agent in chosen),
            *(replace(result, agent=named[result.agent]) for result in results if result.agent in chosen),
        ],
        [spec.model_copy(update={"agent": named[spec.agent]}) for spec in wanted if spec.agent in chosen],
    )


def _compare(
    results: Sequence[Result], entry: Entry, tasks: Sequence[str] | None, planned: Sequence[RunSpec]
) -> Comparison:
    theirs = entry.results()
    asked_for = {result.task.name for result in results} | {spec.task.name for spec in planned}
    names = [part.task.name for part in entry.tasks if part.task.name in (asked_for if tasks is None else tasks)]
    ours = [result for result in results if result.task.name in names]
    if not ours:
        raise MissingRunsError(f"Agent {results[0].agent!r} has no finished run of a task of {entry.agent}'s entry.")
    notes = _check_sides(ours, [result for result in theirs if result.task.name in names])
    if holes := find_holes(ours, planned, names):
        raise MissingRunsError(f"Suite {entry.suite!r}: {describe_holes(holes)}.")
    columns, reference = _columns(ours, names), _columns(theirs, names)
    if len(names) < len(entry.tasks):
        notes = [f"{len(names)} of the suite's {len(entry.tasks)} tasks are compared: {', '.join(names)}.", *notes]
    notes += _setting_notes(ours, theirs)
    if shared := _shared_seeds(ours, theirs):
        notes.append(f"{entry.agent}'s entry holds these very runs: seeds {', '.join(map(str, shared))}.")
    return Comparison(
        suite=entry.suite,
        suite_version=entry.suite_version,
        agent=results[0].agent,
        privileged=results[0].privileged,
        information=results[0].information,
        seeds=len(columns[names[0]]),
        entry=entry.agent,
        entry_privileged=entry.privileged,
        entry_information=entry.information,
        entry_seeds=len(reference[names[0]]),
        tasks=tuple(_difference(name, {name: columns[name]}, {name: reference[name]}) for name in names),
        overall=_difference("all", columns, reference),
        overall_iqm=_difference("all", columns, reference, scores.iqm),
        notes=tuple(notes),
    )


def _check_sides(ours: Sequence[Result], theirs: Sequence[Result]) -> list[str]:
    """Check that two sides are comparable; their agents may have the same name."""
    return check_comparable(
        [
            *(replace(result, agent=f"{result.agent} of the runs") for result in ours),
            *(replace(result, agent=f"{result.agent} of the board") for result in theirs),
        ]
    )


def _setting_notes(ours: Sequence[Result], theirs: Sequence[Result]) -> list[str]:
    """Note where the two sides have one agent with different hyperparameters."""
    entered = {result.task.name: result for result in theirs}
    notes = []
    for task, mine in {result.task.name: result for result in ours}.items():
        if mine.agent != entered[task].agent:
            continue
        here, there = mine.hyperparameters, entered[task].hyperparameters
        changed = sorted(name for name in here.keys() & there.keys() if here[name] != there[name])
        one_sided = sorted(here.keys() ^ there.keys())
        if changed:
            notes.append(f"{mine.agent} has other hyperparameters than its entry on {task}: {', '.join(changed)}.")
        if one_sided:
            notes.append(f"{mine.agent} and its entry on {task} do not both have {', '.join(one_sided)}.")
    return notes


def _shared_seeds(ours: Sequence[Result], theirs: Sequence[Result]) -> list[int]:
    """Return the seeds whose runs are the entry's own: there the two sides are not independent."""
    entered = {_signature(result) for result in theirs}
    return sorted(
        {mine.seed for mine in ours if is_telling(mine.task, mine.return_curve) and _signature(mine) in entered}
    )


def _signature(result: Result) -> tuple[Any, ...]:
    return result.agent, result.task.name, result.seed, result.return_curve


def _columns(results: Sequence[Result], tasks: Sequence[str]) -> Columns:
    return {task: {result.seed: result.scores for result in results if result.task.name == task} for task in tasks}


def _difference(task: str, ours: Columns, theirs: Columns, statistic: scores.Statistic = scores.mean) -> Difference:
    auc, reference = matrix(ours, "auc"), matrix(theirs, "auc")
    runs, entry = float(statistic(auc)), float(statistic(reference))
    return Difference(
        task=task,
        runs=runs,
        entry=entry,
        difference=runs - entry,
        interval=scores.difference_interval(auc, reference, np.random.default_rng(BOOTSTRAP_SEED), statistic=statistic),
        p_value=permutation_p(auc, reference, np.random.default_rng(BOOTSTRAP_SEED), statistic=statistic),
        improvement=scores.probability_of_improvement(auc, reference),
        improvement_interval=scores.improvement_interval(auc, reference, np.random.default_rng(BOOTSTRAP_SEED)),
    )


def render_comparisons(comparisons: Sequence[Comparison], form: str = "md", *, width: int | None = None) -> str:
    """Return comparisons as text that ends in a newline.

    Args:
        comparisons: One a pair of agent and entry.
        form: One of `COMPARISON_FORMATS`.
        width: Columns of the terminal for "rich"; None for plain text of any width.

    Raises:
        ValueError: There is no such format.
    """
    if form not in COMPARISON_FORMATS:
        raise ValueError(unknown("format", form, COMPARISON_FORMATS))
    if form == "json":
        return as_json(comparisons)
    agents = dict.fromkeys(comparison.agent for comparison in comparisons)
    return draw([_grid([one for one in comparisons if one.agent == agent]) for agent in agents], form, width=width)


def _grid(comparisons: Sequence[Comparison]) -> Grid:
    """Return the table of one agent: a row an entry."""
    first = comparisons[0]
    name = marked(first.agent, first.privileged, first.information)
    marks = [(first.privileged, first.information)]
    marks += [(one.entry_privileged, one.entry_information) for one in comparisons]
    return Grid(
        title=f"{name} ({first.seeds} seed{'s' * (first.seeds > 1)}, mean AUC "
        f"{number(first.overall.runs)}) minus each entry of suite {first.suite}, version {first.suite_version}",
        header=["Entry", "Seeds", "Its AUC", *(difference.task for difference in first.tasks), "Mean AUC", "IQM"],
        rows=[
            [
                marked(one.entry, one.entry_privileged, one.entry_information),
                str(one.entry_seeds),
                number(one.overall.entry),
                *(_text(difference) for difference in (*one.tasks, one.overall, one.overall_iqm)),
            ]
            for one in comparisons
        ],
        footnotes=[
            "Difference of mean AUC, and of its IQM, with 95 % stratified-bootstrap intervals, paired by task; more is "
            "better.",
            P_VALUE,
            *([SINGLE] if any(one.overall.interval is None for one in comparisons) else []),
            *explained(marks),
            *dict.fromkeys(note for one in comparisons for note in one.notes),
            drops_line(max(one.seeds * len(one.tasks) for one in comparisons), ()),
        ],
    )


def _text(difference: Difference) -> str:
    ends = f"{number(difference.difference, '+')}\n{interval_text(difference.interval)}"
    return f"{ends}\np {p_text(difference.p_value)}, {difference.improvement:.0%}"


def p_text(p_value: float) -> str:
    """Return a p-value with three decimals, and no smaller than that."""
    return f"{p_value:.3f}" if p_value >= 0.0005 else "< 0.001"  # rounds to 0.000 below
