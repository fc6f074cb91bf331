"""Writes the page of what was measured on Fetch: `python docs/write_fetch.py docs/fetch.md`.

Every number follows from the entries and the pending runs of `fetch-sparse` and from notes/fetch-diagnostics.csv.
"""

from __future__ import annotations

import sys
import textwrap
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
import pandas as pd

from sprl_bench import leaderboard
from sprl_bench.records import Hardware, Scores
from sprl_bench.scores import Array, bootstrap_interval, mean
from sprl_bench.studies.verdicts import Difference, difference
from sprl_bench.tasks import find_suite

ROOT: Final = Path(__file__).parents[1]
SUITE: Final = "fetch-sparse"
REACH: Final = "FetchReach-substep2"
AGENTS: Final = ("ppo", "icm", "eco", "rnd", "sprl", "sprl@scaled", "eco@scaled", "gt-grid", "random")
HIGH_COST: Final = "sprl+cost_scale=0.5"  # ten times Table 5's, on Reach alone
LOW_COST: Final = "sprl+cost_scale=0.005"  # a tenth of Table 5's
OTHER_VALUES: Final = {
    LOW_COST: "cost: a tenth",
    HIGH_COST: "cost: tenfold",
    "sprl@scaled": "schedule",
    "eco@scaled": "schedule",
}
SEEDS: Final = 5
REWARD_LIMIT: Final = 10.0  # of a training reward on Fetch


@dataclass(frozen=True)
class Run:
    """What the page needs of a run."""

    agent: str
    task: str
    seed: int
    scores: Scores
    wall_time_s: float | None
    machines: str


HEAD: Final = """# Fetch: what the numbers say

The suite `fetch-sparse` has four tasks with a reward of 1 at the goal, which ends the episode, and 0 elsewhere. An
action lasts a tenth (Reach) to a half of what it lasts in Gymnasium-Robotics, so chance finds the goal rarely. Budgets
are 1,000,000 env steps on Reach and 600,000 on the others. All agents share one frame
([choice](../notes/fetch-frame.md); [pilot](../notes/fetch-pilot.md)) and take the paper's values of Table 5; those of
`rnd` and `gt-grid`, which it lacks, are ours. `@scaled` fits the network's schedule to the budget.
† marks a privileged agent.

`python docs/write_fetch.py docs/fetch.md` computes this page from the finished runs.
"""
OPEN: Final = """
Whether the score of `sprl` is due to the method or to Table 5's values, we do not know before all rows of FetchReach
are there."""
READING: Final = """\
*AUC* is the area under the learning curve, *final* the success in the last tenth, each the mean of five seeds. *To .5*
is the median of the env steps until a hundredth of the budget has a success of .5. *Minus `ppo`* is the difference in
AUC, bold if its 95 % interval excludes 0; with five seeds, one that barely does so is only a hint
([why](scores.md#confidence-intervals)).
"""


def page() -> str:
    """Return the whole page."""
    runs = finished()
    parts = [reach(runs), objects(runs), [READING], other_values(runs), inside(), missing(runs), cost(runs)]
    return "\n".join([HEAD, *(line for part in parts for line in part)])


def finished() -> list[Run]:
    """Return the finished runs of the suite with seeds 0 to 4: those of entries, and those that wait for theirs."""
    folder = ROOT / "leaderboards"
    of_entries = [
        Run(entry.agent, one.task.name, run.seed, run.scores, run.wall_time_s, machines(entry.hardware))
        for entry in (leaderboard.find_entries(folder / SUITE) if (folder / SUITE).exists() else [])
        for one in entry.tasks
        for run in one.results
    ]
    waiting = [
        Run(
            run.spec.agent,
            run.spec.task.name,
            run.spec.seed,
            run.scores,
            run.wall_time_s,
            machines([run.hardware]),
        )
        for pending in leaderboard.find_pending(folder)
        if pending.suite == SUITE
        for run in pending.runs
    ]
    return [run for run in of_entries + waiting if run.seed < SEEDS]


def machines(hardware: Iterable[Hardware]) -> str:
    """Return what the runs were made on, as text."""
    return " or ".join(
        sorted({f"{one.cpu.removesuffix(' Processor').replace('(R)', '')}, {one.cores} cores" for one in hardware})
    )


def chosen(runs: Sequence[Run], agent: str, task: str) -> list[Run]:
    """Return the runs of an agent on a task."""
    return [run for run in runs if (run.agent, run.task) == (agent, task)]


def aucs(runs: Sequence[Run]) -> Array:
    """Return the scores of some runs."""
    return np.array([run.scores.auc for run in runs])


def named(agent: str) -> str:
    """Return an agent's name, Markdown."""
    return f"`{agent}`" + (" †" if agent.startswith("gt-") else "")


def reach(runs: Sequence[Run]) -> Iterator[str]:
    """Yield the table of Reach: agents with all seeds, the best first."""
    whole = complete(runs, (*AGENTS, HIGH_COST, LOW_COST), REACH)
    yield f"## {REACH}\n"
    yield "| agent | AUC | final | to .5 | minus `ppo` |"
    yield "|---|---:|---:|---:|---:|"
    for agent, own in sorted(whole.items(), key=lambda item: -aucs(item[1]).mean()):
        last = np.mean([run.scores.final for run in own])
        minus = interval_of(difference("", [aucs(own)], [aucs(whole["ppo"])])) if agent != "ppo" else ""
        yield f"| {named(agent)} | {score_of(own)} | {last:.3f} | {solved(own)} | {minus} |"
    yield ""


def objects(runs: Sequence[Run]) -> Iterator[str]:
    """Yield the AUC on the tasks with an object; nothing before there are any."""
    tasks = [task.name for task in find_suite(SUITE).tasks if task.name != REACH]
    whole = {task: complete(runs, AGENTS, task) for task in tasks}
    begun = [task for task in tasks if whole[task]]
    if not begun:
        return
    yield f"## The tasks with an object: AUC\n\n| agent | {' | '.join(begun)} |"
    yield f"|---|{'---:|' * len(begun)}"
    for agent in AGENTS:
        cells = [score_of(whole[task][agent]) if agent in whole[task] else "" for task in begun]
        if any(cells):
            yield f"| {named(agent)} | {' | '.join(cells)} |"
    yield ""


def complete(runs: Sequence[Run], agents: Iterable[str], task: str) -> dict[str, list[Run]]:
    """Return the runs of each agent that has all seeds of a task."""
    own = {agent: chosen(runs, agent, task) for agent in agents}
    return {agent: found for agent, found in own.items() if len(found) == SEEDS}


def score_of(runs: Sequence[Run]) -> str:
    """Return the mean AUC with its interval, as text."""
    ends = bootstrap_interval(aucs(runs)[:, None], mean, np.random.default_rng(0))
    assert ends is not None
    return f"{aucs(runs).mean():.3f} [{ends.low:.3f}, {ends.high:.3f}]"


def solved(runs: Sequence[Run]) -> str:
    """Return the median of the steps to the threshold; a seed that never gets there counts as later than all others."""
    steps = sorted(map(time_to_half, runs))
    middle = steps[len(steps) // 2]
    return "never" if middle == float("inf") else f"{middle:,.0f}"


def interval_of(found: Difference) -> str:
    """Return a difference with its interval as text, bold if it is significant."""
    assert found.interval is not None
    text = f"{found.value:+.3f} [{found.interval.low:+.3f}, {found.interval.high:+.3f}]"
    return text if found.outcome == "not decided" else f"**{text}**"


def other_values(runs: Sequence[Run]) -> Iterator[str]:
    """Yield what other values change of SPRL and ECO on Reach; nothing before there are any."""
    rows, outcomes = [], set()
    for agent, change in OTHER_VALUES.items():
        ours, table = chosen(runs, agent, REACH), chosen(runs, agent.split("@")[0].split("+")[0], REACH)
        if len(ours) == len(table) == SEEDS:
            found = difference("", [aucs(ours)], [aucs(table)])
            seeds = ", ".join(f"{score:.2f}" for score in aucs(ours))
            rows.append(f"| {named(agent)} | {change} | {seeds} | {interval_of(found)} |")
            outcomes.add(found.outcome)
    if not rows:
        return
    yield "## Is it the method or its values?\n"
    yield f"{REACH}: the AUC of each seed, and the mean difference from the agent with Table 5's values.\n"
    yield "| agent | changed | seeds 0 to 4 | minus Table 5's |"
    yield "|---|---|---|---:|"
    table = chosen(runs, "sprl", REACH)
    yield f"| {named('sprl')} | nothing | {', '.join(f'{score:.2f}' for score in aucs(table))} |  |"
    yield from rows
    yield ""
    if outcomes == {"not decided"}:
        yield "Five seeds decide none of these differences.\n"
    yield textwrap.fill(pace(runs), width=120) + "\n"


def pace(runs: Sequence[Run]) -> str:
    """Return how many seeds of SPRL learn Reach as fast as PPO, and how many late or never."""
    slowest = max(time_to_half(run) for run in chosen(runs, "ppo", REACH))
    half = next(task.budget for task in find_suite(SUITE).tasks if task.name == REACH) / 2
    agents = ["sprl", *(agent for agent in OTHER_VALUES if agent.startswith("sprl"))]
    times = [time_to_half(run) for agent in agents for run in chosen(runs, agent, REACH)]
    fast, late = sum(time <= slowest for time in times), sum(time > half for time in times)
    return (
        f"Of these {len(times)} runs of `sprl`, {fast} reach a success of .5 within {slowest:,.0f} env steps, as all "
        f"of `ppo` do, and {late} only after half of the budget, or never."
    )


def time_to_half(run: Run) -> float:
    """Return the env steps until the success in a hundredth of the budget is at least .5; never is infinite."""
    return run.scores.steps_to_threshold or float("inf")


def inside() -> Iterator[str]:
    """Yield what happened inside the agents with a reachability network."""
    table = pd.read_csv(ROOT / "notes" / "fetch-diagnostics.csv")
    if "trusted_at" not in table:
        return
    yield "## Inside the agents with a reachability network\n"
    yield textwrap.fill(
        f"{REACH}, means over the seeds whose diagnostics were kept. *Trusted at*: the env steps from which the "
        "network is used. *Charged*: the share of steps that SPRL calls a violation. *Bonus*: of a mean step; *goal*: "
        "its reward after normalisation; both in the last tenth.",
        width=120,
    )
    yield ""
    yield "| agent | seeds | trusted at | accuracy there | at the end | charged | at the end | bonus | goal |"
    yield "|---|---:|---:|---:|---:|---:|---:|---:|---:|"
    known = table[table.trusted_at.notna() & (table.seed < SEEDS) & (table.task == REACH)]
    for agent, rows in known.groupby("agent", sort=True):
        of = rows.mean(numeric_only=True)
        cells = [
            named(str(agent)),
            len(rows),
            f"{of.trusted_at:,.0f}",
            shown(of.accuracy_when_trusted),
            shown(of.last_accuracy),
            shown(of.get("violations", np.nan)),
            shown(of.get("last_violations", np.nan)),
            f"{of.last_bonus_a_step:.4f}",
            f"{(1 / rows.last_reward_deviation).clip(upper=REWARD_LIMIT).mean():.1f}",
        ]
        yield f"| {' | '.join(map(str, cells))} |"
    yield ""


def shown(share: float) -> str:
    """Return a share as text, empty for what an agent does not have."""
    return "" if np.isnan(share) else f"{share:.2f}"


def missing(runs: Sequence[Run]) -> Iterator[str]:
    """Yield what has not been run, and the command that does."""
    tasks = [task.name for task in find_suite(SUITE).tasks]
    gaps = {task: [agent for agent in AGENTS if len(chosen(runs, agent, task)) < SEEDS] for task in tasks}
    gaps[REACH] += [agent for agent in (HIGH_COST, LOW_COST) if len(chosen(runs, agent, REACH)) < SEEDS]
    if not any(gaps.values()):
        return
    yield "## What is missing\n"
    for task, agents in gaps.items():
        if {*agents} >= {*AGENTS}:
            yield f"- {task}: all agents."
        elif agents:
            yield f"- {task}: {', '.join(map(named, agents))}."
    if {HIGH_COST, LOW_COST, "sprl@scaled"} & set(gaps[REACH]):
        yield OPEN
    yield "\nThis completes the runs, and takes what is finished as it is:\n"
    yield "```"
    yield f"sprl-bench run --suite {SUITE} --agents {','.join(AGENTS)} --known leaderboards/pending"
    if costs := ",".join(agent for agent in (HIGH_COST, LOW_COST) if agent in gaps[REACH]):
        yield f"sprl-bench run --suite {SUITE} --task {REACH} --agents {costs} --known leaderboards/pending"
    yield "```\n"


def cost(runs: Sequence[Run]) -> Iterator[str]:
    """Yield what the runs took."""
    yield "## Cost\n"
    yield "Core-hours, beside other work:\n"
    yield "| machine | runs | hours |"
    yield "|---|---:|---:|"
    for machine in sorted({run.machines for run in runs}):
        times = [run.wall_time_s for run in runs if run.machines == machine]
        yield f"| {machine} | {len(times)} | {hours(times)} |"
    yield ""


def hours(times: Sequence[float | None]) -> str:
    """Return the sum of times in seconds as hours; a time that no record has makes it a lower bound."""
    known = [time for time in times if time is not None]
    return ("over " if len(known) < len(times) else "") + f"{sum(known) / 3600:.1f}"


if __name__ == "__main__":
    Path(sys.argv[1]).write_text(page(), encoding="utf-8")
