"""Does an agent learn as the published one of its name does?

The agent is trained on FourRooms-7x7 and on the probes, and each mean learning curve is held against the published
band. The seeds are others than those of the published runs.
"""

from __future__ import annotations

import logging
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np

from sprl_bench.known_answers.bands import (
    CHANCE,
    FIFTHS,
    FIGURES,
    Band,
    band_of,
    figures_of,
    published_figures,
    usual_deviation,
)
from sprl_bench.known_answers.probe_envs import KNOWN, register
from sprl_bench.records import RunRecord, RunSpec
from sprl_bench.run import run
from sprl_bench.scores import Array
from sprl_bench.suite import expand
from sprl_bench.tasks import SUITES, Suite, Task

BUDGETS: Final = {"SPRLProbe/Any-v0": 2_000}
PROBE_BUDGET: Final = 30_000
FOUR_ROOMS: Final = replace(SUITES["smoke"].tasks[0], name="FourRooms-7x7")
PROBES: Final = tuple(
    Task(
        name=f"Probe{env_id.removeprefix('SPRLProbe/').removesuffix('-v0')}",
        env_id=env_id,
        budget=BUDGETS.get(env_id, PROBE_BUDGET),
        domain="grid",
        score_range=(-1.0, 1.0) if env_id == "SPRLProbe/Observation-v0" else (0.0, 1.0),
    )
    for env_id in KNOWN
)
SUITE: Final = Suite("check", 1, (*PROBES, FOUR_ROOMS))
SEEDS: Final = (0, 1, 2)
BAND_SEEDS: Final = tuple(range(200, 210))
Progress = Callable[[RunSpec], None]


@dataclass(frozen=True)
class Verdict:
    """Where a task's learning curve lies.

    Attributes:
        task: Its name.
        seeds: Of the runs.
        figures: The mean return in each fifth of the budget, in all of it, and in its best fifth, over the runs: [7].
        band: Where it should lie.
        known: The mean return of chance and the best, where both are known exactly.
    """

    task: str
    seeds: tuple[int, ...]
    figures: Array
    band: Band
    known: tuple[float, float] | None

    @property
    def outside(self) -> dict[int, str]:
        """The figures, from 0, that are out of the band, each with "below" or "above"."""
        return self.band.outside(self.figures)

    @property
    def passed(self) -> bool:
        """Whether every figure is in the band."""
        return not self.outside

    @property
    def sentence(self) -> str:
        """The verdict in words."""
        if self.passed:
            return "in the band"
        where = [f"{side} it {_part(figure)}" for figure, side in sorted(self.outside.items())]
        return f"OUT OF THE BAND: {', '.join(where)}"


def _part(figure: int) -> str:
    """Return which part of the budget a figure is of."""
    percent = 100 // FIFTHS
    return (*(f"at {percent * part} to {percent * (part + 1)} %" for part in range(FIFTHS)), "overall", "at its best")[
        figure
    ]


def check_agent(
    agent: str,
    *,
    like: str = "",
    tasks: Sequence[str] | None = None,
    out: Path | None = None,
    progress: Progress = lambda _: None,
) -> Iterator[Verdict]:
    """Train an agent, and yield a verdict for each task on which the published agent has a band.

    Args:
        agent: An installed agent's name, or "package.module:factory" of your own.
        like: The published agent that it should learn like; by default the agent itself.
        tasks: Names of some of `SUITE`'s tasks; by default all.
        out: A folder to keep the runs in; by default they are removed.
        progress: Called before each run.

    Raises:
        ValueError: The agent is unknown, or has no published band.
    """
    bands = {task.name: _published(task, like or agent) for task in SUITE.tasks}
    chosen = [SUITE.task(name) for name in tasks or [task.name for task in SUITE.tasks]]
    register()
    with _folder(out) as folder:
        for task in chosen:
            runs = bands[task.name]
            if runs is None:
                continue
            records = list(_train(agent, task, folder, progress))
            figures = np.mean([figures_of(one.return_curve) for one in records], axis=0)
            least = 0.0 if (like or agent) == CHANCE else usual_deviation(task.name)
            yield Verdict(task.name, SEEDS, figures, band_of(runs, len(SEEDS), least), KNOWN.get(task.env_id))


def _published(task: Task, agent: str) -> Array | None:
    """Return the figures of an agent's published runs; where every return is 1, whatever the agent does, these ones."""
    if KNOWN.get(task.env_id) == (1.0, 1.0):
        return np.ones((len(BAND_SEEDS), FIGURES))
    return published_figures(task.name, agent)


def _train(agent: str, task: Task, folder: Path, progress: Progress) -> Iterator[RunRecord]:
    for spec in expand(SUITE, [agent], SEEDS, tasks=[task.name]):
        progress(spec)
        with _without_warnings():
            record = run(spec, folder)
        yield record


@contextmanager
def _without_warnings() -> Iterator[None]:
    """Leave out that a run of a probe starts over when interrupted: it is short."""
    logger = logging.getLogger("sprl_bench")
    level = logger.level
    logger.setLevel(logging.ERROR)
    try:
        yield
    finally:
        logger.setLevel(level)


@contextmanager
def _folder(out: Path | None) -> Iterator[Path]:
    if out is not None:
        yield out
        return
    with tempfile.TemporaryDirectory() as folder:
        yield Path(folder)
