"""Pictures: that they are drawn, hold what they should, and are the same each time."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from sprl_bench import plots
from sprl_bench.records import RunRecord
from sprl_bench.tables import MissingRunsError, Result, tabulate

MakeRecord = Callable[..., RunRecord]
BEGINNINGS = {".png": b"\x89PNG", ".svg": b"<?xml", ".pdf": b"%PDF"}


@pytest.mark.parametrize("suffix", plots.SUFFIXES)
def test_the_same_records_give_the_same_picture(suffix: str, make_record: MakeRecord, tmp_path: Path) -> None:
    records, pictures = [make_record(seed=seed, level=seed / 10) for seed in range(3)], []
    for name in ("first", "second"):
        plots.plot(records, tmp_path / f"{name}{suffix}")
        pictures.append((tmp_path / f"{name}{suffix}").read_bytes())
    assert pictures[0] == pictures[1]
    assert pictures[0].startswith(BEGINNINGS[suffix])


def test_there_is_a_panel_a_task_and_a_line_an_agent(grid_7x7: list[RunRecord]) -> None:
    figure = plots.draw_curves(tabulate(grid_7x7), [Result.of(record) for record in grid_7x7])
    panels = figure.axes
    assert [axes.get_title() for axes in panels] == ["FourRooms-7x7", "KeyDoors-7x7"]
    for axes, budget in zip(panels, (500_000, 2_000_000), strict=True):
        assert len(axes.get_lines()) == 2
        assert len(axes.collections) == 4  # bands, and the lines of single runs
        assert axes.get_xlim() == (0, budget)
        steps, means = axes.get_lines()[0].get_data()
        assert (steps[0], steps[-1]) == (budget / 100, budget)
        assert means[0] == pytest.approx(0.52 if axes is panels[0] else 0.62)
    [legend] = figure.legends
    assert [text.get_text() for text in legend.get_texts()] == ["ppo (5 seeds)", "random (5 seeds)"]


def test_returns_outside_the_range_are_shown_too(make_record: MakeRecord) -> None:
    """A task of no suite may have any."""
    records = [make_record(seed=seed, curve=[20.0] * 100) for seed in range(2)]
    figure = plots.draw_curves(tabulate(records), [Result.of(record) for record in records])
    low, high = figure.axes[0].get_ylim()
    assert low < 0
    assert high > 20


def test_only_the_tables_agents_are_drawn(grid_7x7: list[RunRecord]) -> None:
    figure = plots.draw_curves(tabulate(grid_7x7, agents=["ppo"]), [Result.of(record) for record in grid_7x7])
    assert [len(axes.get_lines()) for axes in figure.axes] == [1, 1]


def test_one_seed_has_no_band_and_a_privileged_agent_its_mark(make_record: MakeRecord) -> None:
    records = [make_record("gt-grid", privileged=True)]
    figure = plots.draw_curves(tabulate(records), [Result.of(record) for record in records])
    assert len(figure.axes[0].collections) == 0
    assert figure.legends[0].get_texts()[0].get_text() == "gt-grid († privileged, 1 seed)"


def test_several_suites_are_told_apart(make_record: MakeRecord, grid_7x7: list[RunRecord]) -> None:
    records = [make_record("icm"), *grid_7x7]
    figure = plots.draw_curves(tabulate(records), [Result.of(record) for record in records])
    titles = [axes.get_title() for axes in figure.axes]
    assert titles == ["grid-7x7: FourRooms-7x7", "grid-7x7: KeyDoors-7x7", "smoke: FourRooms-7x7"]
    colours = {line.get_color() for axes in figure.axes for line in axes.get_lines()}
    assert len(colours) == 3  # one an agent, in all panels


def test_many_agents_are_told_apart(make_record: MakeRecord) -> None:
    records = [make_record(f"agent-{number}") for number in range(20)]
    figure = plots.draw_curves(tabulate(records), [Result.of(record) for record in records])
    assert len({(line.get_color(), line.get_linestyle()) for line in figure.axes[0].get_lines()}) == 20


def test_presets_of_an_agent_share_its_colour(make_record: MakeRecord) -> None:
    records = [make_record(agent) for agent in ("sprl@tuned", "ppo", "sprl", "ppo@tuned", "sprl@ablation")]
    figure = plots.draw_curves(tabulate(records), [Result.of(record) for record in records])
    [legend] = figure.legends
    looks = {
        text.get_text().split()[0]: (line.get_color(), line.get_linestyle())
        for text, line in zip(legend.texts, legend.get_lines(), strict=True)
    }
    assert len(set(looks.values())) == 5
    assert looks["sprl"][0] == looks["sprl@tuned"][0] == looks["sprl@ablation"][0] != looks["ppo"][0]
    assert looks["ppo"][0] == looks["ppo@tuned"][0]
    assert looks["sprl"][1] == looks["ppo"][1] == "-"


def test_variants_of_one_agent_have_their_own_colours(make_record: MakeRecord) -> None:
    """In a picture of k = 2, 3, 5 and 7 the dashes of one colour would be hard to tell apart."""
    records = [make_record(agent) for agent in ("sprl", "sprl+k=3", "sprl+k=5", "sprl+k=7")]
    figure = plots.draw_curves(tabulate(records), [Result.of(record) for record in records])
    lines = figure.axes[0].get_lines()
    assert len({line.get_color() for line in lines}) == 4
    assert {line.get_linestyle() for line in lines} == {"-"}


@pytest.mark.parametrize(
    "agents",
    [
        [f"sprl@{preset}" for preset in "abcdefghij"],
        [*"abcdefgh", "a@tuned", "b@tuned", "h@tuned"],
        [f"{agent}@{preset}" for agent in "abcdefg" for preset in "wxyz"],
    ],
)
def test_no_two_agents_look_alike(agents: list[str], make_record: MakeRecord) -> None:
    records = [make_record(agent) for agent in agents]
    figure = plots.draw_curves(tabulate(records), [Result.of(record) for record in records])
    assert len({(line.get_color(), line.get_linestyle()) for line in figure.axes[0].get_lines()}) == len(agents)


@pytest.mark.parametrize("letters", [3, 30, 60])
def test_the_legend_stays_inside_the_picture(letters: int, make_record: MakeRecord) -> None:
    records = [make_record("m" * letters + str(number), privileged=True) for number in range(6)]
    figure = plots.draw_curves(tabulate(records), [Result.of(record) for record in records])
    figure.canvas.draw()
    [legend] = figure.legends
    box, whole = legend.get_window_extent(), figure.bbox
    assert box.height < whole.height / 2
    assert box.x0 >= 0
    assert box.x1 <= whole.x1


def test_missing_runs_are_refused_or_counted(make_record: MakeRecord, tmp_path: Path) -> None:
    records = [make_record(seed=0), make_record(seed=1, status="incomplete")]
    with pytest.raises(MissingRunsError):
        plots.plot(records, tmp_path / "curves.png")
    assert not list(tmp_path.iterdir())
    plots.plot(records, tmp_path / "curves.svg", allow_missing=True)
    assert "ppo (1 seed)" in (tmp_path / "curves.svg").read_text()


def test_names_are_drawn_as_they_are(make_record: MakeRecord, tmp_path: Path) -> None:
    plots.plot([make_record("_$a$")], tmp_path / "curves.svg")
    assert "_$a$ (1 seed)" in (tmp_path / "curves.svg").read_text()


def test_another_suffix_is_refused(grid_7x7: list[RunRecord], tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"'\.pngg'; did you mean '\.png'\? Allowed: \.pdf, \.png, \.svg"):
        plots.plot(grid_7x7, tmp_path / "curves.pngg")
    assert not list(tmp_path.iterdir())


def test_matplotlib_is_loaded_when_something_is_drawn() -> None:
    code = "import sys, sprl_bench.plots; sys.exit('matplotlib' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
