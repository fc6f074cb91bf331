"""How many more seeds an agent's runs need to decide whether they differ from a board's entries."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any, Final

import numpy as np

from sprl_bench.leaderboard.comparison import COMPARISON_FORMATS, Comparison, compare, p_text
from sprl_bench.leaderboard.entries import Entry
from sprl_bench.power import ALPHA, MOST, POWER, power, seeds_needed
from sprl_bench.records import Data, RunRecord, RunSpec
from sprl_bench.scores import Array
from sprl_bench.sequential import LOOKS, decide, looks_to_decide
from sprl_bench.suggestions import unknown
from sprl_bench.tables import BOOTSTRAP_SEED, Result
from sprl_bench.tables.text_table import Grid, as_json, draw, number

NOTES: Final = (
    f"Power: the share of resampled experiments whose permutation p-value is at most {ALPHA}. More seeds: until it is "
    f"{POWER:.0%}, if the difference stays as it is; the entry keeps its seeds, or (both) gets as many. A dash: no "
    f"number up to {MOST:,}.",
    "One by one: the rule that may be looked at after each seed. Do not look at p-values again and again instead.",
)


class Plan(Data):
    """What is decided between an agent's runs and an entry, and what it would take.

    Attributes:
        comparison: The difference, its interval and its p-value.
        power: With the seeds that there are; None for a single seed.
        more_seeds: Of the runs, with the entry as it is; None where no number is enough, or for a single seed.
        more_seeds_of_both: Of the runs where the entry has as many seeds; None likewise.
        looks: After how many seeds one may look; chosen in advance.
        decided_at: The seed, from 1, at which the sequential rule decides; None if it has not yet.
        decided_better: Whether it decides that the runs score higher.
        more_looks: After how many more seeds it decides in 80 % of resampled continuations; None where it does not.
    """

    comparison: Comparison
    power: float | None
    more_seeds: int | None
    more_seeds_of_both: int | None
    looks: int
    decided_at: int | None
    decided_better: bool
    more_looks: int | None


def plan_seeds(
    records: Iterable[RunRecord],
    entries: Sequence[Entry],
    *,
    agent: str | None = None,
    tasks: Sequence[str] | None = None,
    planned: Iterable[RunSpec] = (),
    looks: int = LOOKS,
) -> list[Plan]:
    """Return how many more seeds each comparison needs; arguments and errors are those of `compare`.

    Args:
        records: Finished runs; incomplete ones count as missing.
        entries: Of one suite.
        agent: The agent to compare, or None for all.
        tasks: The tasks to compare, or None for all that the agent has runs of.
        planned: Specs of all runs that there should be.
        looks: After how many seeds the sequential rule may be looked at, chosen before the first.
    """
    everything = list(records)
    finished = [Result.of(record) for record in everything if record.status == "complete"]
    of_entries = {entry.agent: entry.results() for entry in entries}
    return [
        _plan(one, _matrix(finished, one.agent, one), _matrix(of_entries[one.entry], one.entry, one), looks)
        for one in compare(everything, entries, agent=agent, tasks=tasks, planned=planned)
    ]


def _matrix(results: Sequence[Result], agent: str, comparison: Comparison) -> Array:
    """Return AUCs [S, T] in the order of seeds, on the tasks of a comparison."""
    found = {
        (one.task.name, one.seed): one.scores.auc
        for one in results
        if one.agent == agent and one.suite == comparison.suite
    }
    tasks = [one.task for one in comparison.tasks]
    seeds = sorted({seed for task, seed in found if task == tasks[0]})
    return np.array([[found[task, seed] for task in tasks] for seed in seeds])


def _plan(comparison: Comparison, ours: Array, theirs: Array, looks: int) -> Plan:
    decision = decide(ours, theirs, looks=looks)
    fields: dict[str, Any] = {
        "comparison": comparison,
        "looks": looks,
        "decided_at": decision.look,
        "decided_better": decision.better,
        **dict.fromkeys(("power", "more_seeds", "more_seeds_of_both", "more_looks")),
    }
    if min(len(ours), len(theirs)) > 1:
        fields |= _outlook(ours, theirs, looks, open_still=decision.look is None)
    return Plan(**fields)


def _outlook(ours: Array, theirs: Array, looks: int, *, open_still: bool) -> dict[str, Any]:
    needed = [seeds_needed(ours, theirs, BOOTSTRAP_SEED, both=both) for both in (False, True)]
    more = [None if one is None else one - len(ours) for one in needed]
    decided = looks_to_decide(ours, theirs, POWER, looks=looks) if open_still else None
    return {
        "power": power(ours, theirs, (len(ours), len(theirs)), np.random.default_rng(BOOTSTRAP_SEED)),
        "more_seeds": more[0],
        "more_seeds_of_both": more[1],
        "more_looks": None if decided is None else decided - len(ours),
    }


def render_plans(plans: Sequence[Plan], form: str = "md", *, width: int | None = None) -> str:
    """Return plans as text that ends in a newline; the arguments and errors are those of `render_comparisons`."""
    if form not in COMPARISON_FORMATS:
        raise ValueError(unknown("format", form, COMPARISON_FORMATS))
    return as_json(plans) if form == "json" else draw([_grid(plans)], form, width=width)


def _grid(plans: Sequence[Plan]) -> Grid:
    first = plans[0].comparison
    return Grid(
        title=f"Seeds that would decide, suite {first.suite}, version {first.suite_version}",
        header=["Agent", "Entry", "Seeds", "Mean AUC", "p", "Power", "More seeds", "More (both)", "One by one"],
        rows=[_row(one) for one in plans],
        footnotes=[*NOTES, *dict.fromkeys(note for one in plans for note in one.comparison.notes)],
    )


def _row(plan: Plan) -> list[str]:
    one = plan.comparison
    return [
        one.agent,
        one.entry,
        f"{one.seeds} and {one.entry_seeds}",
        number(one.overall.difference, "+"),
        p_text(one.overall.p_value),
        "-" if plan.power is None else f"{plan.power:.0%}",
        _count(plan.more_seeds),
        _count(plan.more_seeds_of_both),
        _one_by_one(plan),
    ]


def _count(seeds: int | None) -> str:
    return "-" if seeds is None else str(seeds)


def _one_by_one(plan: Plan) -> str:
    """Return what the sequential rule says."""
    if plan.decided_at is not None:
        return f"{'better' if plan.decided_better else 'worse'}, decided at seed {plan.decided_at} of {plan.looks}"
    outlook = f"about {plan.more_looks} more" if plan.more_looks else "most likely not"
    return f"open after {min(plan.comparison.seeds, plan.looks)} of {plan.looks}; {outlook}"
