"""Figure 22: where an agent walks when its own cost calls the walk cheap, and where when it calls it dear."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import gymnasium
import numpy as np

from sprl_bench import plots
from sprl_bench.policies import restore
from sprl_bench.records import RunSpec, read
from sprl_bench.records.folder import SPEC
from sprl_bench.scores import Array
from sprl_bench.studies.agent_places import STEP, has_screen, place_of, room_of, screen_of
from sprl_bench.studies.verdicts import Verdict, all_above, difference, nothing

if TYPE_CHECKING:  # the extra `plots`
    from matplotlib.figure import Figure

WALKS: Final = 200
LONGEST: Final = 60  # steps, as in the paper
SHORTEST: Final = 5  # steps; shorter ones are left out
SEED: Final = 22  # of the first walk's environment


@dataclass(frozen=True)
class Walk:
    """Steps of one episode without a reward, in one room.

    Attributes:
        positions: [T + 1, 2], the agent's places (`place_of`).
        cost: The share of its steps that the agent's own cost charges.
    """

    positions: Array
    cost: float

    @property
    def revisits(self) -> float:
        """The share of its steps that lead to a position where the walk has been."""
        places = [tuple(position) for position in self.positions.tolist()]
        return sum(place in places[:step] for step, place in enumerate(places) if step) / (len(places) - 1)


@functools.cache
def walks_of(folder: Path) -> tuple[Walk, ...]:
    """Return walks of the trained agent of a run, in environments that it was not trained in.

    Raises:
        FileNotFoundError: The folder holds no run.
        UnplayableRunError: The run keeps no agent that can act.
        ValueError: The agent has no cost.
    """
    spec = read(folder / SPEC, RunSpec)
    agent = restore(folder, spec)
    env = _env_of(spec)
    if not hasattr(agent, "costs"):
        raise ValueError(f"agent is {spec.agent!r}; it must have a method costs(), as sprl and gt-sprl have.")
    policy = agent.policy(env.observation_space, env.action_space, SEED)
    costs = agent.costs(env.observation_space, env.action_space)
    walks = [_walk(env, policy, costs, SEED + number) for number in range(WALKS)]
    env.close()
    return tuple(walk for walk in walks if len(walk.positions) > SHORTEST)


def _env_of(spec: RunSpec) -> Any:
    arguments: dict[str, Any] = dict(spec.task.arguments)
    return gymnasium.make(f"sprl_bench:{spec.task.env_id}", **arguments)


def _walk(env: Any, policy: Any, costs: Any, seed: int) -> Walk:
    observation, info = env.reset(seed=seed)
    seen, positions, room = [observation.copy()], [place_of(env, observation, info)], room_of(env)
    for _ in range(LONGEST):
        observation, reward, terminated, truncated, info = env.step(policy(observation))
        if reward or terminated or truncated or room_of(env) != room:  # the step that ends a stretch has no cost
            break
        seen.append(observation.copy())
        positions.append(place_of(env, observation, info))
    charged = costs(np.stack(seen)) if len(seen) > 1 else np.zeros(1)
    return Walk(np.array(positions), float(charged.mean()))


def split(walks: Sequence[Walk]) -> tuple[list[Walk], list[Walk]]:
    """Return the cheapest and the dearest quarter; both are empty if all walks cost the same."""
    costs = np.array([walk.cost for walk in walks])
    if len(walks) < 8 or costs.min() == costs.max():
        return [], []
    order = np.argsort(costs, kind="stable")
    quarter = len(walks) // 4
    return [walks[place] for place in order[:quarter]], [walks[place] for place in order[-quarter:]]


def judge_walks(folders: Sequence[Path]) -> Verdict:
    """Judge the claim that dear walks revisit places more often than cheap ones, run by run."""
    if not folders:
        return nothing("runs are missing")
    differences = []
    for folder in folders:
        cheap, dear = split(walks_of(folder))
        if not cheap:
            return nothing(f"the walks of {folder.name} all have the same cost")
        shares = [np.array([walk.revisits for walk in some]) for some in (dear, cheap)]
        differences.append(difference(f"revisits, dear minus cheap, {folder.name}", [shares[0]], [shares[1]]))
    return all_above(differences)


def draw_walks(folders: Sequence[Path], picture: Path) -> None:
    """Draw the visits of cheap and of dear walks, one row a run."""

    def draw() -> Figure:
        from matplotlib.figure import Figure  # noqa: PLC0415 - the extra `plots`, and slow to load

        figure = Figure(figsize=(6.4, 3.0 * len(folders)), layout="constrained")
        grid = figure.subplots(len(folders), 2, squeeze=False)
        for row, folder in zip(grid, folders, strict=True):
            background = _background(folder)
            for axes, some, name in zip(row, split(walks_of(folder)), ("Lowest", "Highest"), strict=True):
                _draw_visits(axes, some, walks_of(folder), background)
                mean = np.mean([walk.cost for walk in some]) if some else 0.0
                axes.set_title(f"{name} quarter: {mean:.0%} of steps charged", fontsize=9)
                axes.set_xticks([])
                axes.set_yticks([])
        return figure

    plots.save(draw, picture)


def _background(folder: Path) -> Array | None:
    """Return the screen on which a run's walks begin, [H, W] grey; None where there is no screen."""
    env = _env_of(read(folder / SPEC, RunSpec))
    env.reset(seed=SEED)
    background = screen_of(env) if has_screen(env) else None
    env.close()
    return background


def _draw_visits(axes: Any, some: Sequence[Walk], everything: Sequence[Walk], background: Array | None) -> None:
    """Draw how often each place was visited: over the area of all walks, or in red on the background."""
    if background is None:
        area = np.concatenate([walk.positions for walk in everything])
        axes.imshow(_visits(some, area.min(axis=0), area.max(axis=0)), cmap="Reds")
        return
    height, width = background.shape
    visits = _visits(some, np.zeros(2, int), np.array([width, height]) // STEP)
    across, down = visits.shape[1] * STEP, visits.shape[0] * STEP
    axes.imshow(background, cmap="gray", vmin=0, vmax=510, extent=(0, width, height, 0))  # half as bright
    axes.imshow(np.ma.masked_equal(visits, 0), cmap="autumn_r", extent=(0, across, down, 0))
    axes.set_xlim(0, width)
    axes.set_ylim(height, 0)


def _visits(some: Sequence[Walk], low: Array, high: Array) -> Array:
    """Return how often each place was visited, [H, W], from the place `low` (x, y) to `high`."""
    counts = np.zeros(tuple((high - low + 1)[::-1]))
    for walk in some:
        for x, y in walk.positions - low:
            counts[y, x] += 1
    return counts
