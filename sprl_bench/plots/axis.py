"""A score against the value of a hyperparameter, or of an argument of the environment."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from sprl_bench import scores
from sprl_bench.plots.sheet import check_width, lay_out
from sprl_bench.plots.style import Look, check_suffix, draw_caption, draw_grid, draw_legend, looks_of, save
from sprl_bench.suggestions import unknown
from sprl_bench.tables import BOOTSTRAP_SEED, Result

if TYPE_CHECKING:  # the extra `plots`
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

WIDE = 20  # values whose largest is this many times the smallest are drawn on a logarithmic axis


@dataclass(frozen=True)
class Point:
    """Scores at one value of the axis.

    Attributes:
        panel: The task; of an argument's axis, the environment.
        agent: The agent, without the value.
        value: Of the hyperparameter or argument.
        aucs: One a seed, in the order of the seeds.
    """

    panel: str
    agent: str
    value: Any
    aucs: tuple[float, ...]


def points_of(results: Sequence[Result], axis: str, default: Any = None) -> list[Point]:
    """Return the points of an axis, by panel, agent and value.

    Agents without such a hyperparameter are left out, as are environments without such an argument.

    Args:
        results: Finished runs.
        axis: The name of a hyperparameter, or of an argument of the environment.
        default: The value of an argument that a task does not give; None to leave such tasks out.

    Raises:
        ValueError: No run has it, or all have the same value.
    """
    arguments = {name for result in results for name in result.task.arguments}
    hyperparameters = {name for result in results for name in result.hyperparameters}
    if axis not in arguments | hyperparameters:
        raise ValueError(unknown("axis", axis, arguments | hyperparameters))
    groups: dict[tuple[str, str, Any], dict[int, float]] = {}
    for result in results:
        key: tuple[str, str, Any]
        if axis in arguments and result.task.arguments.get(axis, default) is not None:
            key = result.task.env_id, result.agent, result.task.arguments.get(axis, default)
        elif axis not in arguments and axis in result.hyperparameters:
            key = result.task.name, _without(result.agent, axis), result.hyperparameters[axis]
        else:
            continue
        groups.setdefault(key, {})[result.seed] = result.scores.auc
    if len({value for *_, value in groups}) < 2:
        raise ValueError(f"axis is {axis!r}; these runs must have more than one value of it.")
    points = [Point(*key, tuple(auc for _, auc in sorted(seeds.items()))) for key, seeds in groups.items()]
    return sorted(points, key=lambda point: (point.panel, point.agent, _order(point.value)))


def _without(agent: str, key: str) -> str:
    """Return an agent's name without one of its differences."""
    return "+".join(part for part in agent.split("+") if not part.startswith(f"{key}="))


def _order(value: Any) -> tuple[bool, Any]:
    return isinstance(value, str), value


def plot_axis(
    results: Sequence[Result], output: Path, axis: str, default: Any = None, *, width: str | None = None
) -> None:
    """Draw the AUC against an axis into a .png, .svg or .pdf file, one panel a task, one line an agent.

    The arguments and errors are those of `points_of`, and a suffix or a width (one of `WIDTHS`) that is not allowed.
    """
    check_suffix(output)
    check_width(width)
    points = points_of(results, axis, default)
    save(lambda: draw_axis(points, axis, width=width), output, width=width)


def draw_axis(points: Sequence[Point], axis: str, *, width: str | None = None) -> Figure:
    """Return a figure of these points: means with their 95 % intervals, and a dot for each seed."""
    from matplotlib.figure import Figure  # noqa: PLC0415 - the extra `plots`, and slow to load

    panels = sorted({point.panel for point in points})
    looks = looks_of(point.agent for point in points)
    sheet = lay_out((len(panels), len(panels)), list(looks), list(looks), width)
    figure = Figure(figsize=sheet.size, layout="constrained")
    values = sorted({point.value for point in points}, key=_order)
    places = _places(values)
    for axes, panel in zip(figure.subplots(sheet.rows, sheet.columns, squeeze=False).flat, panels, strict=False):
        for agent, look in looks.items():
            _draw_line(axes, [point for point in points if (point.panel, point.agent) == (panel, agent)], places, look)
        axes.set_title(panel)
        axes.set_xlabel(axis)
        axes.set_xscale("log" if _is_wide(values) else "linear")
        axes.set_xticks(list(places.values()), [str(value) for value in places], minor=False)
        axes.minorticks_off()
        draw_grid(axes)
    figure.axes[0].set_ylabel("AUC")
    for axes in figure.axes[len(panels) :]:
        axes.set_visible(False)
    draw_caption(figure, "Mean over seeds with 95 % bootstrap intervals; dots are seeds.")
    draw_legend(figure, list(looks.values()), sheet.names, sheet.abreast)
    return figure


def _places(values: Sequence[Any]) -> Mapping[Any, float]:
    """Return where each value is drawn: at itself if all are numbers, else one after the other."""
    if all(isinstance(value, int | float) and not isinstance(value, bool) for value in values):
        return {value: float(value) for value in values}
    return {value: float(place) for place, value in enumerate(values)}


def _is_wide(values: Sequence[Any]) -> bool:
    numbers = _places(values).values()
    return min(numbers) > 0 and max(numbers) >= WIDE * min(numbers)


def _draw_line(axes: Axes, points: Sequence[Point], places: Mapping[Any, float], look: Look) -> None:
    where = [places[point.value] for point in points]
    means = [float(np.mean(point.aucs)) for point in points]
    axes.plot(where, means, color=look.colour, linestyle=look.dashes, marker="o", markersize=4, linewidth=1.4)
    for place, point in zip(where, points, strict=True):
        column = np.asarray(point.aucs)[:, None]
        interval = scores.bootstrap_interval(column, scores.mean, np.random.default_rng(BOOTSTRAP_SEED))
        axes.plot([place] * len(point.aucs), point.aucs, ".", color=look.colour, markersize=3, alpha=0.5)
        if interval is not None:
            axes.vlines(place, *interval, color=look.colour, linewidth=1.2)
