"""Pictures for a paper: widths, legends, fonts, and pictures of whole suites."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from matplotlib import rc_context

from sprl_bench import plots, scores
from sprl_bench.plots.style import RESERVED, looks_of
from sprl_bench.records import RunRecord
from sprl_bench.tables import BOOTSTRAP_SEED, Result, tabulate

MakeRecord = Callable[..., RunRecord]


def _records(make_record: MakeRecord, agents: int, **others: object) -> list[RunRecord]:
    return [
        make_record(f"agent-{number}", seed=seed, level=number / 10 + seed / 50, **others)
        for number in range(agents)
        for seed in range(3)
    ]


@pytest.mark.parametrize(("width", "inches"), plots.WIDTHS.items())
@pytest.mark.parametrize("agents", [2, 9])
def test_a_width_is_kept_and_the_legend_fits_into_it(
    width: str, inches: float, agents: int, make_record: MakeRecord
) -> None:
    records = _records(make_record, agents)
    with rc_context(plots.PAPER):
        figure = plots.draw_curves(tabulate(records), [Result.of(one) for one in records], width=width)
        figure.draw_without_rendering()
    assert figure.get_figwidth() == inches
    legend, canvas = figure.legends[0].get_window_extent(), figure.bbox
    assert legend.x0 >= 0
    assert legend.x1 <= canvas.x1


@pytest.mark.parametrize("width", [None, *plots.WIDTHS])
def test_a_legend_takes_less_than_a_third_of_the_figure(width: str | None, make_record: MakeRecord) -> None:
    records = _records(make_record, 8)
    with rc_context(plots.PAPER if width else plots.STYLE):
        figure = plots.draw_curves(tabulate(records), [Result.of(one) for one in records], width=width)
        figure.draw_without_rendering()
    assert figure.legends[0].get_window_extent().height < figure.bbox.height / 3
    assert "3 seeds" in figure.get_supxlabel() or "(3 seeds)" in figure.legends[0].texts[0].get_text()


def test_pdfs_hold_no_type_3_font(make_record: MakeRecord, tmp_path: Path) -> None:
    plots.plot(_records(make_record, 2), tmp_path / "curves.pdf", width="one-column")
    content = (tmp_path / "curves.pdf").read_bytes()
    assert b"/Type3" not in content
    assert re.search(rb"/FontFile2|/CIDFontType2", content)


def test_profiles_are_those_of_the_scores(grid_7x7: list[RunRecord]) -> None:
    matrices = plots.suite_matrices(grid_7x7)
    axes = plots.draw_profiles(matrices).axes[0]
    for line, (_, matrix) in zip(axes.get_lines(), matrices["grid-7x7"].items(), strict=True):
        thresholds, shares = np.asarray(line.get_data())
        np.testing.assert_array_equal(shares, scores.performance_profile(matrix, thresholds))


def test_the_best_agent_is_compared_with_each_other_one(make_record: MakeRecord) -> None:
    matrices = plots.suite_matrices(_records(make_record, 4))
    axes = plots.draw_improvement(matrices).axes[0]
    assert axes.get_xlabel() == "P(agent > agent-3)"
    assert [text.get_text() for text in axes.get_yticklabels()] == ["agent-0", "agent-1", "agent-2"]
    [agents] = matrices.values()
    wanted = scores.improvement_interval(agents["agent-2"], agents["agent-3"], np.random.default_rng(BOOTSTRAP_SEED))
    assert wanted is not None
    [segment] = axes.collections[-1].get_segments()
    assert tuple(segment[:, 0]) == pytest.approx(wanted)


def test_privileged_agents_are_marked_and_the_mark_is_explained(make_record: MakeRecord) -> None:
    records = [
        make_record(agent, seed=seed, level=level, privileged=agent == "oracle")
        for agent, level in {"oracle": 0.9, "ppo": 0.5}.items()
        for seed in range(2)
    ]
    matrices, labels = plots.suite_matrices(records), plots.suite_labels(one.spec for one in records)
    profiles = plots.draw_profiles(matrices, labels=labels)
    assert [text.get_text() for text in profiles.legends[0].texts] == ["oracle †", "ppo"]
    assert profiles.get_supxlabel().split()[-2:] == ["†", "privileged."]
    improvement = plots.draw_improvement(matrices, labels=labels)
    assert improvement.axes[0].get_xlabel() == "P(agent > oracle †)"
    assert "†" not in plots.draw_profiles(matrices).get_supxlabel()


def test_another_agent_has_its_colour_with_and_without_the_reference_agents() -> None:
    for name in ("dqn", "Walker", "mine", "my-bonus", "go-explore"):
        alone = looks_of([name])[name]
        assert looks_of([name, *RESERVED])[name] == alone
        assert alone.colour not in RESERVED.values()


def test_a_board_has_the_pictures_of_its_runs(grid_7x7: list[RunRecord]) -> None:
    results = [Result.of(record) for record in grid_7x7]
    of_board, of_runs = plots.board_matrices(results), plots.suite_matrices(grid_7x7)
    assert of_board.keys() == of_runs.keys()
    for agent, matrix in of_runs["grid-7x7"].items():
        np.testing.assert_array_equal(of_board["grid-7x7"][agent], matrix)


def test_an_agent_has_one_colour_in_every_picture(make_record: MakeRecord) -> None:
    records = [make_record(agent, seed=seed) for agent in ("ppo", "mine") for seed in range(2)]
    curves = plots.draw_curves(tabulate(records), [Result.of(one) for one in records]).axes[0]
    profiles = plots.draw_profiles(plots.suite_matrices(records)).axes[0]
    assert {line.get_color() for line in curves.get_lines()} == {line.get_color() for line in profiles.get_lines()}


def test_unknown_kinds_and_widths_are_refused(make_record: MakeRecord, tmp_path: Path) -> None:
    records, output = [make_record()], tmp_path / "picture.png"
    with pytest.raises(ValueError, match=r"Unknown width 'wide'; allowed: one-column, two-column\."):
        plots.plot(records, output, width="wide")
    with pytest.raises(ValueError, match=r"Unknown kind 'pie'; allowed: improvement, profiles\."):
        plots.plot_suites(plots.suite_matrices(records), output, "pie")
    with pytest.raises(ValueError, match=r"kind is 'improvement'; it must be of 2 or more agents"):
        plots.plot_suites(plots.suite_matrices(records), output, "improvement")
    assert not output.exists()
