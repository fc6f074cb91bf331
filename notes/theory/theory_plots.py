"""The theory drawn: how many trajectories the constraint leaves on a map, and how soon it leads to the goal.

Drawn without a display. matplotlib is loaded when something is drawn.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from sprl_bench import theory
from sprl_bench.envs.grid.encoding import AGENT, GOAL, WALL
from sprl_bench.plots import STYLE, SUFFIXES, UNDATED
from sprl_bench.suggestions import unknown

if TYPE_CHECKING:  # the extra `plots`
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

KS: Final = (0, 1, 2, 3, 5, 10)
HORIZON: Final = 30
EPISODES: Final = 1000
UNCONSTRAINED: Final = "#555555"
LOOKS: Final = {"Cardinal moves": ("#0072B2", "o"), "Turns and forward": ("#D55E00", "s")}
SHADES: Final = {WALL: "#b8b8b8", GOAL: "#009E73", AGENT: "#D55E00"}
Integers = NDArray[np.int64]


def plot_theory(observation: NDArray[np.uint8], output: Path, **choices: Any) -> None:
    """Draw the theory on one map into a file; the same map and choices give the same bytes.

    Args:
        observation: Of a FourRooms task, uint8 [S, S, 3].
        output: A .png, .svg or .pdf file.
        **choices: Those of `draw_theory`.

    Raises:
        ValueError: The file's suffix is another, or the map has a key or a door.
        ModuleNotFoundError: matplotlib is not installed.
    """
    suffix = output.suffix.lower()
    if suffix not in SUFFIXES:
        raise ValueError(unknown("suffix of a picture:", output.suffix, SUFFIXES))

    import matplotlib as mpl  # noqa: PLC0415 - the extra `plots`, and slow to load

    with mpl.rc_context({**STYLE, "text.parse_math": True}):  # powers of ten
        figure = draw_theory(observation, **choices)
        figure.savefig(output, format=suffix[1:], dpi=140, metadata=dict(UNDATED[suffix]))


def draw_theory(
    observation: NDArray[np.uint8],
    *,
    ks: Sequence[int] = KS,
    horizon: int = HORIZON,
    episodes: int = EPISODES,
    seed: int = 0,
) -> Figure:
    """Return a figure of the shares of admissible trajectories in both models, and of the steps to the goal.

    Args:
        observation: Of a FourRooms task, uint8 [S, S, 3].
        ks: The longest stretches that must be shortest paths, one line each; 0 for no constraint.
        horizon: The most steps of a trajectory.
        episodes: Simulated walks for each point.
        seed: Of the walks; each point has a stream of its own.
    """
    from matplotlib.figure import Figure  # noqa: PLC0415 - the extra `plots`, and slow to load

    worlds = dict(zip(LOOKS, (theory.cardinal_world(observation), theory.pose_world(observation)), strict=True))
    figure = Figure(figsize=(11, 3.8), layout="constrained")
    left, middle, right = figure.subplots(1, 3, width_ratios=(1.3, 1.3, 1))
    middle.sharey(left)
    for axes, (name, world) in zip((left, middle), worlds.items(), strict=True):
        _draw_shares(axes, world, ks, horizon)
        axes.set_title(f"{name}, {theory.num_reachable(world)} states")
    left.set_ylabel("Share of trajectories that are admissible")
    _draw_map(left.inset_axes((0.03, 0.04, 0.36, 0.44)), observation)
    _draw_steps(right, worlds, ks, episodes, seed)
    return figure


def _draw_shares(axes: Axes, world: theory.World, ks: Sequence[int], horizon: int) -> None:
    """Draw a line for each k, named at its end; one that falls together with another is dashed over it."""
    colours, names = _colours(ks), defaultdict[tuple[float, ...], list[str]](list)
    for k in ks:
        shares = tuple(theory.shares(world, k, horizon))
        axes.plot(shares, color=colours[k], linewidth=1.9, linestyle=(0, (3, 2)) if shares in names else "-")
        names[shares].append(str(k) if k else "0 (all)")
    for shares, together in names.items():
        axes.annotate(
            f"k = {', '.join(together)}", (horizon, shares[-1]), (4, 0), textcoords="offset points", va="center"
        )
    nearest = len(theory.shortest_path(world)) - 1
    axes.axvline(nearest, ymax=0.96, color=UNCONSTRAINED, linewidth=0.9, linestyle=":")
    axes.annotate(
        f"a shortest path arrives: {nearest} steps", (nearest, 1), (nearest - 0.5, 8), color=UNCONSTRAINED, size=8
    )
    axes.set_yscale("log")
    axes.set_ylim(top=60)
    axes.set_xlim(0, horizon)
    axes.set_xlabel("Steps T")
    _lighten(axes)


def _colours(ks: Sequence[int]) -> dict[int, Any]:
    """Return grey for no constraint and ever darker colours for larger k."""
    from matplotlib import colormaps  # noqa: PLC0415 - the extra `plots`, and slow to load

    bound = sorted(k for k in ks if k > 0)
    shades = colormaps["viridis_r"](np.linspace(0.1, 1, len(bound)))
    return {0: UNCONSTRAINED, **dict(zip(bound, shades, strict=True))}


def _draw_steps(axes: Axes, worlds: Mapping[str, theory.World], ks: Sequence[int], episodes: int, seed: int) -> None:
    """Draw the mean number of steps to the goal against k, with 95 % intervals of the normal kind."""
    for (name, world), (colour, marker) in zip(worlds.items(), LOOKS.values(), strict=True):
        walks = [theory.steps_to_goal(world, k, np.random.default_rng((seed, k)), episodes=episodes) for k in ks]
        means = [walk.mean() for walk in walks]
        errors = [1.96 * walk.std() / np.sqrt(episodes) for walk in walks]
        axes.errorbar(
            range(len(ks)), means, errors, color=colour, marker=marker, markersize=4.5, capsize=2.5, label=name
        )
    axes.set_title("Mean steps until the goal")
    axes.set_xticks(range(len(ks)), [str(k) for k in ks])
    axes.set_xlabel("k")
    axes.set_ylabel(f"{episodes} walks, uniform over admissible actions")
    axes.set_ylim(0, axes.get_ylim()[1] * 1.25)
    axes.legend(loc="upper right")
    _lighten(axes)


def _lighten(axes: Axes) -> None:
    axes.grid(visible=True, color="#e6e6e6", linewidth=0.6)
    axes.set_axisbelow(True)


def _draw_map(axes: Axes, observation: NDArray[np.uint8]) -> None:
    """Draw walls, agent and goal."""
    from matplotlib.patches import Rectangle  # noqa: PLC0415 - the extra `plots`, and slow to load

    size = len(observation)
    for (y, x), kind in np.ndenumerate(observation[..., 0]):
        axes.add_patch(Rectangle((x, y), 1, 1, facecolor=SHADES.get(int(kind), "white"), edgecolor="#dddddd", lw=0.4))
    axes.set_xlim(0, size)
    axes.set_ylim(size, 0)
    axes.set_aspect("equal", anchor="SW")
    axes.set_axis_off()
