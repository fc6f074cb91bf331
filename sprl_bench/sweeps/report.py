"""What came of a sweep: a page, a table of all numbers, and one picture an agent."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from sprl_bench.plots import save
from sprl_bench.records import write_bytes
from sprl_bench.sweeps.declaration import Declaration
from sprl_bench.sweeps.ranking import Ranked, Ranking
from sprl_bench.sweeps.sensitivity import marginal

if TYPE_CHECKING:  # the extra `plots`
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

PAGE, NUMBERS = "report.md", "report.csv"
SHOWN = 20  # settings of an agent on the page


def write_report(declaration: Declaration, rankings: Sequence[Ranking], folder: Path) -> list[Path]:
    """Write the page, the table and the pictures into a sweep's folder, and return their paths.

    Raises:
        ModuleNotFoundError: matplotlib, of the extra `plots`, is not installed.
    """
    pictures = {ranking.agent: folder / f"{ranking.agent.replace(':', '-')}.png" for ranking in rankings}
    page = folder / PAGE
    write_bytes(page, render(declaration, rankings, {agent: path.name for agent, path in pictures.items()}).encode())
    write_bytes(folder / NUMBERS, as_csv(rankings).encode())
    drawn = [ranking for ranking in rankings if ranking.settings]
    for ranking in drawn:
        save(lambda ranking=ranking: draw_agent(ranking), pictures[ranking.agent])  # type: ignore[misc]
    return [page, folder / NUMBERS, *(pictures[ranking.agent] for ranking in drawn)]


def render(declaration: Declaration, rankings: Sequence[Ranking], pictures: dict[str, str] | None = None) -> str:
    """Return the page, Markdown; with pictures by agent if they are given."""
    tasks = ", ".join(f"{task} for {budget:,} env steps" for task, budget in declaration.tasks.items())
    lines = [
        f"# Sweep on {declaration.suite}, version {declaration.suite_version}",
        "",
        f"{tasks}; seeds {', '.join(map(str, declaration.seeds))}. Intervals: 95 %, stratified bootstrap over seeds.",
        f"Rule, declared before the first run: {declaration.rule}",
    ]
    for ranking in rankings:
        lines += ["", *_section(ranking)]
        if pictures and ranking.settings:
            lines += ["", f"![AUC against each hyperparameter]({pictures[ranking.agent]})"]
    return "\n".join(lines) + "\n"


def _section(ranking: Ranking) -> list[str]:
    lines = [f"## {ranking.agent}", ""]
    if ranking.chosen is None:
        lines += [f"Not complete: {ranking.missing} runs are missing, so no setting is chosen.", ""]
    else:
        lines += [f"Chosen: `{ranking.chosen.setting.name}`{_tie(ranking.ties)}.", "", *_sensitivity_lines(ranking), ""]
    names = list(ranking.values[0]) if ranking.settings else []
    head = ["rank", *names, *ranking.tasks, "mean AUC"]
    rows = [_row(place, ranked) for place, ranked in enumerate(ranking.settings[:SHOWN], start=1)]
    lines += [f"| {' | '.join(row)} |" for row in (head, ["---"] * len(head), *rows)]
    if len(ranking.settings) > SHOWN:
        lines.append(f"\n{len(ranking.settings) - SHOWN} more settings are in {NUMBERS}.")
    return lines


def _tie(others: int) -> str:
    if not others:
        return ""
    return f", the first declared of {others + 1} settings with exactly this score; the sweep cannot tell them apart"


def _row(place: int, ranked: Ranked) -> list[str]:
    values = [str(value) for value in ranked.setting.values.values()]
    interval = f" [{ranked.interval.low:.3f}, {ranked.interval.high:.3f}]" if ranked.interval else ""
    partial = "" if ranked.complete else " (runs missing)"
    return [str(place), *values, *(f"{auc:.3f}" for auc in ranked.by_task), f"{ranked.mean:.3f}{interval}{partial}"]


def _sensitivity_lines(ranking: Ranking) -> list[str]:
    found = ranking.sensitivity
    if found is None:
        return []
    tuned = f": {', '.join(f'`{name}`' for name in found.tuned)}" if found.tuned else ""
    return [
        f"- The best setting of each task has {found.by_task:.3f}, one setting for all {found.overall:.3f}: "
        f"{found.loss:.3f} is lost by one for all. With few seeds, part of it is chance.",
        f"- To keep 95 % of the first score, {found.dimensionality} of {len(ranking.values[0])} hyperparameters must "
        f"be tuned for each task{tuned}.",
    ]


def as_csv(rankings: Sequence[Ranking]) -> str:
    """Return one line for each setting, task and seed; an AUC that is missing is empty."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["agent", "rank", "setting", "task", "seed", "auc"])
    for ranking in rankings:
        for place, ranked in enumerate(ranking.settings, start=1):
            for (row, column), auc in np.ndenumerate(ranked.aucs):
                value = "" if np.isnan(auc) else repr(float(auc))
                run = ranking.tasks[column], ranking.seeds[row]
                writer.writerow([ranking.agent, place, ranked.setting.name, *run, value])
    return text.getvalue()


def draw_agent(ranking: Ranking) -> Figure:
    """Return a figure with a panel for each hyperparameter: a dot a setting, the mean and the best of each value."""
    from matplotlib.figure import Figure  # noqa: PLC0415 - the extra `plots`, and slow to load

    names = list(ranking.values[0])
    figure = Figure(figsize=(2.6 * len(names), 2.9), layout="constrained")
    grid = figure.subplots(1, len(names), squeeze=False, sharey=True)[0]
    for axes, name in zip(grid, names, strict=True):
        _draw_hyperparameter(axes, ranking, name)
    grid[0].set_ylabel("mean AUC")
    figure.suptitle(ranking.agent)
    figure.supxlabel(
        "Dots: settings. Line: mean over settings with this value. Dashes: the best of them.",
        fontsize=7,
        color="#555555",
    )
    return figure


def _draw_hyperparameter(axes: Axes, ranking: Ranking, name: str) -> None:
    means = ranking.scores.mean(axis=1)
    found = marginal(means, ranking.values, name)
    values = sorted(found, key=_order)
    places = {value: place for place, value in enumerate(values)}
    axes.plot([places[own[name]] for own in ranking.values], means, ".", color="#56B4E9", alpha=0.7)
    axes.plot(range(len(values)), [found[value][0] for value in values], color="#0072B2")
    axes.plot(range(len(values)), [found[value][1] for value in values], "--", color="#0072B2")
    axes.set_xticks(range(len(values)), [str(value) for value in values])
    axes.set_xlabel(name)
    axes.grid(visible=True, color="#e6e6e6", linewidth=0.6)


def _order(value: Any) -> tuple[bool, Any]:
    return isinstance(value, str), value
