"""Scores along an axis: points by hand, drawn and refused."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from sprl_bench import plots
from sprl_bench.plots import Point
from sprl_bench.records import RunRecord
from sprl_bench.tables import Result

MakeRecord = Callable[..., RunRecord]


@pytest.fixture(scope="module")
def results(make_record: MakeRecord) -> list[Result]:
    """Plain sprl has k = 2, and two variants of it and of a preset differ in k."""
    agents = {"sprl": 2, "sprl+k=5": 5, "sprl@tuned+bias=0.0+k=3": 3, "sprl@tuned+bias=0.0+k=40": 40}
    runs = [
        make_record(agent, seed=seed, level=0.01 * k + 0.1 * seed, hyperparameters={"k": k, "mode": f"m{k}"})
        for agent, k in agents.items()
        for seed in (1, 0)
    ]
    return [Result.of(run) for run in [*runs, make_record("random", hyperparameters={})]]


def test_points_by_hand(results: list[Result]) -> None:
    task = "FourRooms-7x7"
    points = plots.points_of(results, "k")
    assert [(point.panel, point.agent, point.value) for point in points] == [
        (task, "sprl", 2),
        (task, "sprl", 5),
        (task, "sprl@tuned+bias=0.0", 3),
        (task, "sprl@tuned+bias=0.0", 40),
    ]
    assert points[0].aucs == pytest.approx((0.02, 0.12))


def test_an_argument_of_the_environment_is_an_axis(make_record: MakeRecord) -> None:
    runs = [make_record("ppo", f"FetchReach-substep{n}", suite="sparsity", level=0.1 * n) for n in (2, 6)]
    assert plots.points_of([Result.of(run) for run in runs], "substep") == [
        Point("SPRL/FetchReachSparse-v1", "ppo", n, (pytest.approx(0.1 * n),))
        for n in (2, 6)  # type: ignore[arg-type]
    ]


def test_a_figure_has_means_intervals_and_seeds(results: list[Result]) -> None:
    figure = plots.draw_axis(plots.points_of(results, "k"), "k")
    [axes] = figure.axes
    assert (axes.get_xlabel(), axes.get_ylabel(), axes.get_xscale()) == ("k", "AUC", "log")
    line = axes.get_lines()[0]
    assert line.get_xdata() == pytest.approx([2, 5])
    assert line.get_ydata() == pytest.approx([0.07, 0.1])
    assert [text.get_text() for text in figure.legends[0].get_texts()] == ["sprl", "sprl@tuned+bias=0.0"]
    assert len(axes.collections) == 4  # an interval a point
    words = plots.draw_axis(plots.points_of(results, "mode"), "mode").axes[0]
    assert [label.get_text() for label in words.get_xticklabels()] == ["m2", "m3", "m40", "m5"]


@pytest.mark.parametrize(
    ("axis", "message"),
    [("kk", "Unknown axis 'kk'; did you mean 'k'"), ("level", "Unknown axis 'level'")],
)
def test_what_is_no_axis_is_refused(axis: str, message: str, results: list[Result], tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=message):
        plots.plot_axis(results, tmp_path / "a.png", axis)
    with pytest.raises(ValueError, match="axis is 'k'; these runs must have more than one value of it"):
        plots.plot_axis(results[:1], tmp_path / "a.png", "k")
    plots.plot_axis(results, tmp_path / "a.svg", "k")
    plots.plot_axis(results, tmp_path / "b.svg", "k")
    assert (tmp_path / "a.svg").read_bytes() == (tmp_path / "b.svg").read_bytes()
