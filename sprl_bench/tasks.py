"""Tasks and suites: rows of a table.

A task is an environment id, its arguments, a budget of environment steps and the range of its returns. A suite is a
named, versioned tuple of tasks. Together with the agent and the seed they determine a score.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType

from sprl_bench.scores import BINS
from sprl_bench.suggestions import unknown

Argument = bool | int | float | str


@dataclass(frozen=True)
class Task:
    """One environment, its budget, and the range of its returns.

    Attributes:
        name: In tables and folders.
        env_id: The Gymnasium id.
        budget: Environment steps, summed over all sub-environments; later steps are not scored.
        domain: The family of tasks that presets are for, such as "grid".
        arguments: Keyword arguments of the environment.
        score_range: Lowest and highest return of an episode.
        max_num_envs: The most sub-environments of a run on a leaderboard; None if there is none.
    """

    name: str
    env_id: str
    budget: int
    domain: str
    arguments: Mapping[str, Argument] = field(default_factory=lambda: MappingProxyType({}))
    score_range: tuple[float, float] = (0.0, 1.0)
    max_num_envs: int | None = None


@dataclass(frozen=True)
class Suite:
    """A named, versioned tuple of tasks; its mean AUC is the mean over them.

    Attributes:
        name: Its name.
        version: Raised when a number may move.
        tasks: Its tasks.
        can_rank: Whether its budgets suffice to rank agents; those of a suite for trying things out do not.
    """

    name: str
    version: int
    tasks: tuple[Task, ...]
    can_rank: bool = True

    def task(self, name: str) -> Task:
        """Return the task of that name.

        Raises:
            ValueError: This suite has no such task.
        """
        for task in self.tasks:
            if task.name == name:
                return task
        raise ValueError(unknown(f"task of suite {self.name!r}:", name, [task.name for task in self.tasks]))


def _max_num_envs(budget: int, horizon: int) -> int:
    """Return the most sub-environments whose first full episodes all end within the first bin of the curve.

    Before that only quick successes end, and the curve is too high (docs/scores.md).
    """
    return budget // (BINS * horizon)


def _grid(name: str, budget: int) -> Task:
    return Task(
        name=name,
        env_id=f"SPRL/{name}-v1",
        budget=budget,
        domain="grid",
        max_num_envs=_max_num_envs(budget, horizon=100),
    )


def _fetch(task: str, budget: int, **arguments: int | float) -> Task:
    """Return a Fetch task, named after the arguments in which it differs from the plain one."""
    suffixes = [f"{argument.removeprefix('action_')}{value}" for argument, value in arguments.items()]
    name = "-".join([f"Fetch{task}", *suffixes])
    env_id = f"SPRL/Fetch{task}Sparse-v1"
    return Task(
        name=name,
        env_id=env_id,
        budget=budget,
        domain="fetch",
        arguments=MappingProxyType(arguments),
        max_num_envs=_max_num_envs(budget, horizon=round(1000 / arguments.get("substep", 20))),
    )


_ATARI_BUDGET = 12_000_000  # our choice, appendix F has none: the least that allows Table 3's 12 workers
# The highest human scores that https://github.com/cshenton/atari-leaderboard lists, most of them of Twin Galaxies: an
# upper end that returns of at most 10,000 actions, eleven minutes, do not leave.
_ATARI_RECORDS = {
    "MontezumaRevenge": 1_219_200.0,
    "Freeway": 38.0,
    "MsPacman": 2_654_680.0,
    "Gravitar": 999_950.0,
    "Seaquest": 999_999.0,
    "Hero": 1_000_000.0,
}
REFERENCES: Mapping[str, tuple[float, float]] = MappingProxyType(
    {
        "SPRL/MontezumaRevenge-v1": (0.0, 4753.3),
        "SPRL/Freeway-v1": (0.0, 29.6),
        "SPRL/MsPacman-v1": (307.3, 6951.6),
        "SPRL/Gravitar-v1": (173.0, 3351.4),
        "SPRL/Seaquest-v1": (68.4, 42054.7),
        "SPRL/Hero-v1": (1027.0, 30826.4),
    }
)
"""Published mean scores of random play and of a human tester, by environment id (Badia et al. 2020, "Agent57")."""

ORACLES: Mapping[str, float] = MappingProxyType(
    {
        "SPRL/FourRooms-7x7-v1": 0.9470,
        "SPRL/KeyDoors-7x7-v1": 0.8820,
        "SPRL/FourRooms-11x11-v1": 0.9144,
        "SPRL/KeyDoors-11x11-v1": 0.8180,
        "SPRL/MazeGoalSmall-v1": 297.0,
        "SPRL/MazeGoalLarge-v1": 245.0,
        "SPRL/MazeObjectMany-v1": 98.0,
    }
)
"""Mean returns of the solver, by environment id.

On grids it takes a shortest path, which is optimal: the mean over 100,000 layouts (standard error below
0.0002). In mazes it is a competent player, not an optimal one: the mean over 1,000 episodes (docs/mazes.md).
"""


def _atari(game: str, budget: int) -> Task:
    return Task(
        name=game,
        env_id=f"SPRL/{game}-v1",
        budget=budget,
        domain="atari",
        score_range=(0.0, _ATARI_RECORDS[game]),
        max_num_envs=_max_num_envs(budget, horizon=10_000),
    )


def _maze(level: str, horizon: int, score_range: tuple[float, float]) -> Task:
    """Return the task of a maze; the range holds all returns of 1,000 episodes of the solver (docs/mazes.md)."""
    return Task(
        name=f"Maze{level}",
        env_id=f"SPRL/Maze{level}-v1",
        budget=20_000_000,
        domain="dmlab",
        score_range=score_range,
        max_num_envs=_max_num_envs(20_000_000, horizon),
    )


_GRID_7X7 = (_grid("FourRooms-7x7", 500_000), _grid("KeyDoors-7x7", 2_000_000))
_GRID_11X11 = (_grid("FourRooms-11x11", 2_000_000), _grid("KeyDoors-11x11", 5_000_000))
_OBJECT_TASKS = ("Push", "Slide", "PickAndPlace")
# Substep and budget: appendix A.5's substeps, but for Reach's, which PPO alone solves within a third of the budget. A
# pilot chose the budgets (notes/fetch-pilot.md).
_SPARSE_FETCH = {"Reach": (2, 1_000_000), "Push": (8, 600_000), "Slide": (10, 600_000), "PickAndPlace": (10, 600_000)}
_MAZES = (
    _maze("GoalSmall", 1350, (0.0, 600.0)),
    _maze("GoalLarge", 1800, (0.0, 500.0)),
    _maze("ObjectMany", 1800, (-4.0, 150.0)),
)
_SMOKE = replace(_grid("FourRooms-7x7", 100_000), max_num_envs=None)  # not a benchmark

_ROWS = (
    Suite("grid", 1, _GRID_7X7 + _GRID_11X11),
    Suite("grid-7x7", 1, _GRID_7X7),
    Suite("fetch", 1, (_fetch("Reach", 500_000), *(_fetch(task, 2_000_000) for task in _OBJECT_TASKS))),
    Suite(
        "fetch-sparse",
        1,
        tuple(_fetch(task, budget, substep=substep) for task, (substep, budget) in _SPARSE_FETCH.items()),
    ),
    Suite("sparsity", 1, tuple(_fetch("Reach", 1_000_000, substep=substep) for substep in (2, 3, 4, 6))),
    Suite(
        "noise",
        1,
        tuple(
            _fetch(task, budget, substep=substep, action_noise=noise)
            for noise in (0.03, 0.1, 0.3)
            for task, (substep, budget) in _SPARSE_FETCH.items()
        ),
    ),
    Suite("maze", 1, _MAZES),
    Suite("maze-smoke", 1, tuple(replace(task, budget=20_000, max_num_envs=None) for task in _MAZES), can_rank=False),
    Suite("smoke", 2, (_SMOKE,), can_rank=False),
    Suite("atari", 1, tuple(_atari(game, _ATARI_BUDGET) for game in _ATARI_RECORDS)),
    Suite(
        "atari-smoke",
        1,
        tuple(replace(_atari(game, 20_000), max_num_envs=None) for game in _ATARI_RECORDS),
        can_rank=False,
    ),
)
# The order matters: a run that names no suite belongs to the first one that holds its task.
SUITES: Mapping[str, Suite] = MappingProxyType({suite.name: suite for suite in _ROWS})
CUSTOM = Suite("custom", 0, ())
"""The suite of runs whose task is in no suite; they are not comparable with a suite's scores."""


def with_budget(task: Task, budget: int) -> Task:
    """Return the task under another budget, which becomes part of its name."""
    return replace(task, name=f"{task.name}-{budget}", budget=budget, max_num_envs=None)


def find_suite(name: str) -> Suite:
    """Return the suite of that name.

    Raises:
        ValueError: There is no such suite; the message lists all suites.
    """
    if name not in SUITES:
        raise ValueError(unknown("suite", name, SUITES))
    return SUITES[name]


def too_wide(suite: str, task: str, num_envs: int) -> str:
    """Explain why `num_envs` is too large for a leaderboard; empty if it is allowed."""
    most = {row.name: row.max_num_envs for row in SUITES[suite].tasks}.get(task) if suite in SUITES else None
    if most is None or num_envs <= most:
        return ""
    return (
        f"{num_envs} sub-environments on {task} are more than the {most} that a leaderboard takes: until each has had "
        "a full episode, only quick successes can end, and that must not last longer than one bin of the curve"
    )


def match_task(
    env_id: str,
    arguments: Mapping[str, Argument],
    defaults: Mapping[str, Argument] = MappingProxyType({}),
    suites: Iterable[Suite] = tuple(SUITES.values()),
) -> tuple[Suite, Task] | None:
    """Return the first suite and task with this environment and these arguments, or None.

    Args:
        env_id: The Gymnasium id.
        arguments: Of the environment.
        defaults: Of the arguments that are not given; giving one explicitly changes nothing.
        suites: The suites to search.
    """
    wanted = {**defaults, **arguments}
    for suite in suites:
        for task in suite.tasks:
            if task.env_id == env_id and {**defaults, **task.arguments} == wanted:
                return suite, task
    return None
