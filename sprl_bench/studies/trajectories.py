"""Figure 22: where an agent walks when its own cost calls the walk cheap, and where when it calls it dear."""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
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
from sprl_bench.studies.verdicts import Verdict, all_above, difference, nothing

if TYPE_CHECKING:  # the extra `plots`
    from matplotlib.figure import Figure

WALKS: Final = 200
LONGEST: Final = 60  # steps, as in the paper
SHORTEST: Final = 5  # steps; shorter ones are left out
SEED: Final = 22  # of the first walk's environment


@dataclass(frozen=True)
class Walk:
    """Steps of one episode without a reward.

    Attributes:
        positions: [T + 1, 2], the agent's cell on grids, the gripper's place in steps of 2 cm on Fetch.
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
    arguments: dict[str, Any] = dict(spec.task.arguments)
    env = gymnasium.make(f"sprl_bench:{spec.task.env_id}", **arguments)
    if not hasattr(agent, "costs"):
        raise ValueError(f"agent is {spec.agent!r}; it must have a method costs(), as sprl and gt-sprl have.")
    policy = agent.policy(env.observation_space, env.action_space, SEED)
    costs = agent.costs(env.observation_space, env.action_space)
    walks = [_walk(env, policy, costs, SEED + number) for number in range(WALKS)]
    env.close()
    return tuple(walk for walk in walks if len(walk.positions) > SHORTEST)


def _walk(env: Any, policy: Any, costs: Any, seed: int) -> Walk:
    observation, info = env.reset(seed=seed)
    seen, positions = [observation.copy()], [_position(observation, info)]
    for _ in range(LONGEST):
        observation, reward, terminated, truncated, info = env.step(policy(observation))
        if reward or terminated or truncated:  # the step that ends a stretch has no cost
            break
        seen.append(observation.copy())
        positions.append(_position(observation, info))
    charged = costs(np.stack(seen)) if len(seen) > 1 else np.zeros(1)
    return Walk(np.array(positions), float(charged.mean()))


def _position(observation: Any, info: Mapping[str, Any]) -> tuple[float, float]:
    if "position" in info:
        return tuple(info["position"])
    return tuple(np.floor(np.asarray(observation[:2]) / 0.02))


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
            for axes, some, name in zip(row, split(walks_of(folder)), ("Lowest", "Highest"), strict=True):
                axes.imshow(_visits(some, walks_of(folder)), cmap="Reds")
                mean = np.mean([walk.cost for walk in some]) if some else 0.0
                axes.set_title(f"{name} quarter: {mean:.0%} of steps charged", fontsize=9)
                axes.set_xticks([])
                axes.set_yticks([])
        return figure

    plots.save(draw, picture)


def _visits(some: Sequence[Walk], everything: Sequence[Walk]) -> Array:
    """Return how often each place was visited, [H, W], over the area of all walks."""
    area = np.concatenate([walk.positions for walk in everything]).astype(int)
    low, high = area.min(axis=0), area.max(axis=0)
    counts = np.zeros(tuple((high - low + 1)[::-1]))
    for walk in some:
        for x, y in walk.positions.astype(int) - low:
            counts[y, x] += 1
    return counts
