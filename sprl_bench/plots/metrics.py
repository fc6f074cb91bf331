"""Anything that agents log while they train: one row a metric, one column a task, one line an agent."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from sprl_bench.plots.sheet import check_width, lay_out
from sprl_bench.plots.style import (
    Look,
    check_suffix,
    draw_caption,
    draw_grid,
    draw_legend,
    draw_runs,
    looks_of,
    save,
    short_number,
)
from sprl_bench.records import RunSpec
from sprl_bench.scores import BINS, Array
from sprl_bench.suggestions import unknown

if TYPE_CHECKING:  # the extra `plots`
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Logged = tuple[RunSpec, Sequence[Mapping[str, Any]]]
CLOCK = ("env_steps", "wall_time_s")


def plot_metrics(
    runs: Sequence[Logged],
    output: Path,
    metrics: Sequence[str],
    *,
    tasks: Collection[str] | None = None,
    agents: Collection[str] | None = None,
    width: str | None = None,
) -> None:
    """Draw metrics of runs, finished or not, into a .png, .svg or .pdf file; the same lines give the same bytes.

    A run's lines are averaged in 100 bins of its budget. An agent's line is the mean of its runs in each bin that one
    of them has lines in; the thin lines are the runs.

    Args:
        runs: Specs and lines of diagnostics, as from `sprl_bench.records.find_metrics`.
        output: The file.
        metrics: Names of what the agents log, such as "success" or "reachability_accuracy".
        tasks: Only these.
        agents: Only these.
        width: One of `WIDTHS`; None for one that the panels need.

    Raises:
        ValueError: There is no such metric, task, agent or suffix, or no run.
    """
    check_suffix(output)
    check_width(width)
    chosen = [run for run in runs if _is_in(run[0].task.name, tasks) and _is_in(run[0].agent, agents)]
    for kind, wanted, there in (
        ("task", tasks, {spec.task.name for spec, _ in runs}),
        ("agent", agents, {spec.agent for spec, _ in runs}),
        ("metric", metrics, {name for _, lines in chosen for line in lines for name in line}.difference(CLOCK)),
    ):
        for name in wanted or ():
            if name not in there:
                raise ValueError(unknown(f"{kind} among these runs:", name, there))
    if not chosen or not metrics:
        raise ValueError("There is no run or no metric to draw.")
    save(lambda: draw_metrics(chosen, metrics, width=width), output, width=width)


def _is_in(name: str, wanted: Collection[str] | None) -> bool:
    return wanted is None or name in wanted


def draw_metrics(runs: Sequence[Logged], metrics: Sequence[str], *, width: str | None = None) -> Figure:
    """Return a figure with a panel for each metric and task; tasks stand beside one another where there is room.

    Args:
        runs: Specs and lines of diagnostics.
        metrics: Names of what the agents log.
        width: One of `WIDTHS`; None for one that the panels need.
    """
    from matplotlib.figure import Figure  # noqa: PLC0415 - the extra `plots`, and slow to load

    runs = [run for run in runs if any(line.get(metric) is not None for line in run[1] for metric in metrics)]
    tasks = sorted({spec.task.name for spec, _ in runs})
    looks = looks_of(spec.agent for spec, _ in runs)
    names = [f"{agent} ({len({spec.seed for spec, _ in runs if spec.agent == agent})} seeds)" for agent in looks]
    abreast = lay_out((len(tasks), len(tasks)), names, list(looks), width).columns
    panels = [(metric, task) for metric in metrics for task in tasks]
    if abreast < len(tasks):  # a task's metrics below one another
        abreast, panels = 1, [(metric, task) for task in tasks for metric in metrics]
    sheet = lay_out((len(panels), abreast), names, list(looks), width)
    figure = Figure(figsize=sheet.size, layout="constrained")
    grid = figure.subplots(sheet.rows, sheet.columns, squeeze=False, sharex="col" if abreast == len(tasks) else False)
    for (metric, task), axes in zip(panels, grid.flat, strict=True):
        for agent, look in looks.items():
            its = [run for run in runs if (run[0].task.name, run[0].agent) == (task, agent)]
            _draw_agent(axes, [binned(*run, metric) for run in its], look)
        axes.xaxis.set_major_formatter(short_number)
        draw_grid(axes)
        if metric == metrics[0]:
            axes.set_title(task)
        if metric == metrics[-1]:
            axes.set_xlabel("Environment steps")
        if abreast == 1 or task == tasks[0]:
            axes.set_ylabel(metric)
    draw_caption(figure, "Mean over seeds; thin lines are single runs.")
    draw_legend(figure, list(looks.values()), sheet.names, sheet.abreast)
    return figure


def binned(spec: RunSpec, lines: Sequence[Mapping[str, Any]], metric: str) -> tuple[Array, Array]:
    """Return where each bin ends, and the mean of a metric in it, NaN in a bin without: both [100]."""
    logged = [(line["env_steps"], line[metric]) for line in lines if line.get(metric) is not None]
    sums, counts = np.zeros(BINS), np.zeros(BINS)
    for step, value in logged:
        place = min(BINS, -(-step * BINS // spec.task.budget)) - 1
        sums[place] += value
        counts[place] += 1
    means = np.divide(sums, counts, out=np.full(BINS, np.nan), where=counts > 0)
    return spec.task.budget * np.arange(1, BINS + 1) / BINS, means


def _draw_agent(axes: Axes, runs: Sequence[tuple[Array, Array]], look: Look) -> None:
    there = [(steps, values) for steps, values in runs if not np.isnan(values).all()]
    if not there:
        return
    draw_runs(axes, [(steps[known], values[known]) for steps, values in there for known in [~np.isnan(values)]], look)
    steps, values = there[0][0], np.array([values for _, values in there])
    known = ~np.isnan(values).all(axis=0)
    means = np.nanmean(values[:, known], axis=0)
    axes.plot(steps[known], means, color=look.colour, linestyle=look.dashes, linewidth=1.6)
