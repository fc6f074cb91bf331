"""The studies: rows of a table, and how each judges its claim."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import Final

import numpy as np

from sprl_bench.naming import AgentName
from sprl_bench.scores import Array
from sprl_bench.studies import exact_search
from sprl_bench.studies.reduction import draw_reduction, judge_reduction, reduction_table
from sprl_bench.studies.study import Evidence, Study
from sprl_bench.studies.trajectories import draw_walks, judge_walks
from sprl_bench.studies.verdicts import (
    Difference,
    Verdict,
    all_above,
    best,
    combination,
    difference,
    nothing,
)
from sprl_bench.suggestions import unknown
from sprl_bench.tasks import SUITES

ACCURACY: Final = "reachability_accuracy"
DEADLINE: Final = 400_000  # env steps, of Figure 17
GRIDS: Final = ("FourRooms-7x7", "FourRooms-11x11", "KeyDoors-7x7", "KeyDoors-11x11")
SMALL: Final = ("FourRooms-7x7", "KeyDoors-7x7")
FETCH: Final = tuple(task.name for task in SUITES["fetch-sparse"].tasks)
SPARSITY: Final = tuple(task.name for task in SUITES["sparsity"].tasks)  # sparsest first; that one is on both suites
NOISE: Final = tuple(task.name for task in SUITES["noise"].tasks)
BASELINES: Final = ("ppo", "icm", "eco")
HORIZON: Final = "sprl@ablation+negatives=double"  # k = 5, one stretch of k + 25 steps
HORIZON_WHY: Final = (
    "The appendix's best values for these figures, k = 5 and a tolerance of 25 with a single stretch, differ from its "
    "Table 1; they are the preset `ablation`. Negatives lie beyond the stretch that is asked about (appendix B.1), "
    "because those of Algorithm 1 would teach the network to say no there. `--base` takes other settings."
)


def label(agent: str) -> str:
    """Return the name that a record has for an agent."""
    return str(AgentName.parse(agent))


def judge_best(claimed: int, evidence: Evidence, agents: Sequence[str]) -> Verdict:
    """Judge the claim that the agent at one place is better than each other one, over all tasks with runs."""
    found = {label(agent): [evidence.aucs(label(agent), task) for task in evidence.tasks] for agent in agents}
    if not evidence.tasks or any(len(one) == 0 for scores in found.values() for one in scores):
        return nothing("runs are missing")
    return best(label(agents[claimed]), found)


def judge_sparsity(evidence: Evidence, agents: Sequence[str]) -> Verdict:
    """Judge the claim that SPRL's lead over the mean of the others grows from the densest task to the sparsest."""
    tasks = [task for task in SPARSITY if task in evidence.tasks]
    if len(tasks) < 2:
        return nothing("fewer than two sparsities have runs")
    parts = [*_lead(evidence, agents, tasks[0], 1.0), *_lead(evidence, agents, tasks[-1], -1.0)]
    what = f"lead of sprl over the mean of the others, {tasks[0]} minus {tasks[-1]}"
    return _judge_combination(what, parts)


def _lead(evidence: Evidence, agents: Sequence[str], task: str, weight: float) -> list[tuple[float, Array]]:
    """Return SPRL's score minus the mean of the others' on a task, as a weighted sum."""
    others = [agent for agent in agents if agent != "sprl"]
    own = (weight, evidence.aucs("sprl", task))
    return [own, *((-weight / len(others), evidence.aucs(label(agent), task)) for agent in others)]


def _judge_combination(what: str, parts: Sequence[tuple[float, Array]]) -> Verdict:
    if any(len(one) == 0 for _, one in parts):
        return nothing("runs are missing")
    return all_above([combination(what, parts)])


def judge_noise(evidence: Evidence, agents: Sequence[str]) -> Verdict:
    """Judge the claim that SPRL loses less than the mean of the others from no noise to the most, on each task."""
    differences = []
    for quiet in FETCH:
        noisy = f"{quiet}-noise0.3"
        if not {quiet, noisy} <= set(evidence.tasks):
            continue
        parts = [*_lead(evidence, agents, noisy, 1.0), *_lead(evidence, agents, quiet, -1.0)]
        if any(len(one) == 0 for _, one in parts):
            return nothing("runs are missing")
        differences.append(combination(f"change of sprl's lead with noise .3 on {quiet}", parts))
    return all_above(differences) if differences else nothing("no task has runs without noise and with the most")


def judge_exact(evidence: Evidence, agents: Sequence[str]) -> Verdict:
    """Judge the claim that the learned network scores more than exact search, on each of the 7x7 grids."""
    learned, exact = map(label, agents)
    scores = {task: [evidence.aucs(agent, task) for agent in (learned, exact)] for task in SMALL}
    there = {task: pair for task, pair in scores.items() if task in evidence.tasks}
    if not there or any(len(one) == 0 for pair in there.values() for one in pair):
        return nothing("runs are missing")
    return all_above([difference(f"learned minus exact on {task}", [a], [b]) for task, (a, b) in there.items()])


def judge_accuracy(bar: float, deadline: int, evidence: Evidence, agents: Sequence[str]) -> Verdict:
    """Judge the claim that the last accuracy measured up to a number of env steps is above a bar, on each task."""
    found: list[Difference] = []
    for task in evidence.tasks:
        last = [_last(lines, deadline) for _, lines in evidence.logs(label(agents[0]), task)]
        if not last or None in last:
            return nothing(f"a run on {task} has no measurement of its network within {deadline:,} env steps")
        above = np.array([value for value in last if value is not None]) - bar
        found.append(combination(f"accuracy minus {bar:g} on {task}", [(1.0, above)]))
    return all_above(found) if found else nothing("runs are missing")


def _last(lines: Sequence[Mapping[str, float | None]], deadline: int) -> float | None:
    early = [line for line in lines if (line["env_steps"] or 0) <= deadline]
    known = [line[ACCURACY] for line in early if line.get(ACCURACY) is not None]
    return known[-1] if known else None


def _search_table(evidence: Evidence) -> str:
    """Return the networks' last accuracy within the deadline of Figure 17 beside that of exact search, Markdown."""
    measured = [(spec, _last(lines, DEADLINE)) for spec, lines in evidence.logged]
    return exact_search.comparison([(spec, value) for spec, value in measured if value is not None], evidence.folders)


def _draw_walks(evidence: Evidence, picture: Path) -> bool:
    if evidence.folders:
        draw_walks(evidence.folders, picture)
    return bool(evidence.folders)


def _draw_reduction(_evidence: Evidence, picture: Path) -> bool:
    draw_reduction(picture)
    return True


_ROWS = (
    Study(
        name="fig10",
        title="How does SPRL's score depend on k?",
        claim="k = 5 is best among 3, 5 and 7: a larger k prunes more, but is harder to learn. (k = 2 is Table 1's.)",
        tasks={"grid-7x7": SMALL},
        agents=(f"{HORIZON}+k=2", f"{HORIZON}+k=3", HORIZON, f"{HORIZON}+k=7"),
        judge=partial(judge_best, 2),
        axis="k",
        decisions=HORIZON_WHY,
    ),
    Study(
        name="fig12",
        title="How does SPRL's score depend on the tolerance?",
        claim="A tolerance of 25 is best among 10, 15, 25 and 50.",
        tasks={"grid-7x7": SMALL},
        agents=(f"{HORIZON}+tolerance=10", f"{HORIZON}+tolerance=15", HORIZON, f"{HORIZON}+tolerance=50"),
        judge=partial(judge_best, 2),
        axis="tolerance",
        decisions=HORIZON_WHY,
    ),
    Study(
        name="fig14",
        title="Does it help to show the policy the states before?",
        claim="No: without stacking (0) the score is higher than with 1 or 5 earlier states.",
        tasks={"grid-7x7": SMALL},
        agents=(HORIZON, f"{HORIZON}+stack=1", f"{HORIZON}+stack=5"),
        judge=partial(judge_best, 0),
        axis="stack",
        decisions=HORIZON_WHY,
    ),
    Study(
        name="fig15",
        title="Does SPRL's lead grow with the sparsity of the reward?",
        claim="Yes: with fewer simulation steps an action, SPRL's lead over the other agents grows.",
        tasks={"fetch-sparse": SPARSITY[:1], "sparsity": SPARSITY[1:]},
        agents=(*BASELINES, "sprl"),
        judge=judge_sparsity,
        figure="axis",
        axis="substep",
        decisions="The lead is over the mean of the other agents. Discounts are per reference action; the presets "
        "`per-action` have them per action.",
    ),
    Study(
        name="fig16",
        title="Does SPRL stand noise better than the others?",
        claim="Yes: with Gaussian noise on the actions, SPRL loses less than the other agents.",
        tasks={"fetch-sparse": FETCH, "noise": NOISE},
        agents=(*BASELINES, "sprl"),
        judge=judge_noise,
        figure="axis",
        axis="action_noise",
        axis_default=0.0,
        decisions="No noise at all is the point of comparison; the paper does not show it.",
    ),
    Study(
        name="fig17",
        title="How accurate is the reachability network on the grids?",
        claim="Above .8 within 400,000 env steps.",
        tasks={"grid": GRIDS},
        agents=("sprl",),
        judge=partial(judge_accuracy, 0.8, DEADLINE),
        figure="metric",
        metric=ACCURACY,
        table=_search_table,
        decisions="Accuracy is measured as in appendix B.1, on steps that the network has not been trained on. By that "
        "measure exact search is not always right either: a pair is negative because many steps lie between its "
        "states, not because many are needed.",
    ),
    Study(
        name="fig20",
        title="How accurate is the reachability network on Fetch?",
        claim="Above .95 within 1,000,000 env steps, on all four tasks.",
        tasks={"fetch-sparse": FETCH},
        agents=("sprl",),
        judge=partial(judge_accuracy, 0.95, 1_000_000),
        figure="metric",
        metric=ACCURACY,
        decisions="The paper does not say which substep; these are those of its sparse tasks.",
    ),
    Study(
        name="fig21",
        title="Is a learned network as good as exact search?",
        claim="Overall they are alike, and the learned one scores more on both 7x7 grids; the second part is judged.",
        tasks={"grid": GRIDS},
        agents=("sprl@tuned", "gt-sprl@tuned"),
        judge=judge_exact,
        decisions="Both with the preset `tuned`, as the paper has each at its best.",
    ),
    Study(
        name="fig22",
        title="Which walks does a trained network charge?",
        claim="Dear walks go back and forth; cheap ones move on.",
        tasks={"grid-7x7": ("KeyDoors-7x7",)},
        agents=("sprl@tuned",),
        judge=lambda evidence, _agents: judge_walks(evidence.folders),
        draw=_draw_walks,
        decisions="Walks are the first 60 steps, without the rewarded one, of 200 episodes of the trained agent in new "
        "layouts; cheap and dear are the quarters with the fewest and the most charged steps. Judged by the share of "
        "steps that lead back to a place of the walk.",
    ),
    Study(
        name="fig22-atari",
        title="Which walks does a trained network charge in Montezuma's Revenge?",
        claim="Dear walks go back and forth; cheap ones move on.",
        tasks={"atari": ("MontezumaRevenge",)},
        agents=("sprl",),
        judge=lambda evidence, _agents: judge_walks(evidence.folders),
        draw=_draw_walks,
        decisions="As fig22, in the first room: a walk ends where the agent leaves it. The paper shows Room 6, for "
        "which an agent has to be good. Positions are read from the console's memory, in steps of three pixels.",
    ),
    Study(
        name="sec6.6",
        title="How much does the constraint prune?",
        claim="The larger k, the fewer trajectories are left, and a shortest path to the goal always remains.",
        tasks={},
        agents=(),
        judge=lambda _evidence, _agents: judge_reduction(),
        draw=_draw_reduction,
        table=lambda _evidence: reduction_table(),
        decisions="Counted exactly on the first layouts of ten seeds; nothing is trained.",
    ),
)
STUDIES: Mapping[str, Study] = MappingProxyType({study.name: study for study in _ROWS})


def find_study(name: str) -> Study:
    """Return the study of that name.

    Raises:
        ValueError: There is none; the message lists all.
    """
    if name not in STUDIES:
        raise ValueError(unknown("study", name, STUDIES))
    return STUDIES[name]
