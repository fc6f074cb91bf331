"""Pictures of what agents log: the right lines, and what is refused."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sprl_bench import plots
from sprl_bench.plots.metrics import binned
from sprl_bench.records import RunSpec
from sprl_bench.suite import expand
from sprl_bench.tasks import find_suite

Logged = tuple[RunSpec, list[dict[str, Any]]]


@pytest.fixture(scope="module")
def runs() -> list[Logged]:
    """Two agents with two seeds on two tasks; `random` logs no accuracy, and nobody logs it before step 60,000."""
    specs = expand(find_suite("grid-7x7"), ["sprl+k=3", "random"], [0, 1])
    return [(spec, _lines(spec)) for spec in specs]


def _lines(spec: RunSpec) -> list[dict[str, Any]]:
    lines = []
    for step in range(20_000, spec.task.budget + 1, 20_000):
        line = {"env_steps": step, "wall_time_s": 1.0, "success": 0.25 + 0.5 * spec.seed}
        if spec.agent != "random" and step >= 60_000:
            line["reachability_accuracy"] = 0.9 if spec.seed else None
        lines.append(line)
    return lines


def test_a_row_a_metric_a_column_a_task_and_a_line_an_agent(runs: list[Logged]) -> None:
    figure = plots.draw_metrics(runs, ["success", "reachability_accuracy"])
    assert [axes.get_title() for axes in figure.axes] == ["FourRooms-7x7", "KeyDoors-7x7", "", ""]
    assert [axes.get_ylabel() for axes in figure.axes] == ["success", "", "reachability_accuracy", ""]
    assert [len(axes.get_lines()) for axes in figure.axes] == [2, 2, 1, 1]
    assert {tuple(line.get_ydata()) for line in figure.axes[0].get_lines()} == {(0.5,) * 25}
    assert len(figure.axes[0].collections[0].get_segments()) == 2  # the runs
    steps, accuracy = figure.axes[2].get_lines()[0].get_data()
    assert (steps[0], set(accuracy)) == (60_000, {0.9})
    assert [text.get_text() for text in figure.legends[0].get_texts()] == ["random (2 seeds)", "sprl+k=3 (2 seeds)"]


def test_lines_are_averaged_in_bins(runs: list[Logged]) -> None:
    spec = runs[0][0]
    lines = [{"env_steps": step, "x": float(step)} for step in (1, 5_000, 5_001, 500_000, 500_100)]
    ends, values = binned(spec, lines, "x")
    assert ends.tolist() == list(range(5_000, 505_000, 5_000))
    assert (values[0], values[1], values[-1]) == (2_500.5, 5_001, 500_050)
    assert np.isnan(values[2:-1]).all()


@pytest.mark.parametrize("suffix", plots.SUFFIXES)
def test_the_same_lines_give_the_same_picture(suffix: str, runs: list[Logged], tmp_path: Path) -> None:
    pictures = []
    for name in ("first", "second"):
        plots.plot_metrics(runs, tmp_path / f"{name}{suffix}", ["success"], agents=["random"], tasks=["KeyDoors-7x7"])
        pictures.append((tmp_path / f"{name}{suffix}").read_bytes())
    assert pictures[0] == pictures[1]


@pytest.mark.parametrize(
    ("metrics", "options", "message"),
    [
        (["sucess"], {}, "Unknown metric among these runs: 'sucess'; did you mean 'success'"),
        (["env_steps"], {}, "Unknown metric among these runs: 'env_steps'"),
        (["reachability_accuracy"], {"agents": ["random"]}, "Unknown metric among these runs: 'reach"),
        (["success"], {"tasks": ["KeyDoor"]}, "Unknown task among these runs: 'KeyDoor'; did you mean"),
        (["success"], {"agents": ["sprl"]}, "Unknown agent among these runs: 'sprl'; did you mean"),
        ([], {}, "no metric to draw"),
    ],
)
def test_what_is_not_there_is_refused(
    metrics: list[str], options: dict[str, Any], message: str, runs: list[Logged], tmp_path: Path
) -> None:
    with pytest.raises(ValueError, match=message):
        plots.plot_metrics(runs, tmp_path / "a.png", metrics, **options)
    with pytest.raises(ValueError, match="suffix of a picture"):
        plots.plot_metrics(runs, tmp_path / "a.gif", ["success"])
