"""Published bands, and that a sound agent lies in them and a broken one does not."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from torch import Tensor

from sprl_baselines import ppo
from sprl_bench.cli import main
from sprl_bench.known_answers import SUITE, check_agent
from sprl_bench.known_answers.bands import NARROWEST, band_of, figures_of, published, published_figures, usual_deviation
from sprl_bench.known_answers.check import BAND_SEEDS, SEEDS

ANY, DELAYED, OBSERVATION, FOUR_ROOMS = (task.name for task in SUITE.tasks)
ROOT = Path(__file__).parents[2]
policy_loss = ppo._policy_loss


def test_the_figures_of_a_curve_are_its_fifths_its_mean_and_its_best() -> None:
    assert figures_of(np.arange(100)).tolist() == [9.5, 29.5, 49.5, 69.5, 89.5, 49.5, 89.5]


def test_every_agent_with_a_band_is_checked_every_night() -> None:
    [words] = re.findall("^KNOWN := (.*)$", (ROOT / "Makefile").read_text(), re.MULTILINE)
    assert set(words.split()) == {agent for of_task in published()["figures"].values() for agent in of_task}
    assert "make known-answers" in (ROOT / ".github/workflows/nightly.yml").read_text()


def test_a_band_by_hand() -> None:
    runs = np.tile(np.array([0.3, 0.5])[:, None], 5)
    # Two runs: mean 0.4, deviation sqrt(0.02), one degree of freedom, whose upper 0.1 % point is 318.3.
    half = 318.3088 * np.sqrt(0.02) * np.sqrt(1 / 3 + 1 / 2)
    assert band_of(runs, 3).high == pytest.approx(np.full(5, 0.4 + half), rel=1e-4)
    assert band_of(np.ones((10, 7)), 1).low == pytest.approx(np.full(7, 1 - NARROWEST))


def test_runs_of_the_same_kind_are_out_of_the_band_in_about_1_of_100_checks_or_fewer() -> None:
    drawn, out = np.random.default_rng(0), 0
    for _ in range(1_000):
        runs = 0.5 + 0.1 * drawn.standard_normal((13, 1)) + 0.05 * drawn.standard_normal((13, 7))
        out += bool(band_of(runs[:10], 3).outside(runs[10:].mean(axis=0)))
    assert out / 1_000 < 0.01 + 3 * np.sqrt(0.01 * 0.99 / 1_000)


@pytest.mark.parametrize("task", sorted(published()["figures"]))
def test_so_are_published_runs_with_a_few_late_ones(task: str) -> None:
    """The agents that learn a probe as PPO does, drawn anew as if they were one: ten published runs, three new ones."""
    alike = [published_figures(task, agent) for agent in ("ppo", "icm", "count", "gt-grid")]
    pool = np.concatenate([runs for runs in alike if runs is not None])
    drawn, out, least = np.random.default_rng(0), 0, usual_deviation(task)
    for _ in range(1_000):
        runs = pool[drawn.integers(len(pool), size=13)]
        out += bool(band_of(runs[:10], 3, least).outside(runs[10:].mean(axis=0)))
    assert out / 1_000 < 0.01 + 3 * np.sqrt(0.01 * 0.99 / 1_000)


def test_a_band_names_the_side_on_which_a_curve_leaves_it() -> None:
    band = band_of(np.full((10, 5), 0.5), 1)
    assert band.outside(np.array([0.5, 0.4, 0.5, 0.6, 0.51])) == {1: "below", 3: "above"}


def test_what_is_published_says_how_it_was_made() -> None:
    made = published()["made"]
    assert made["seeds"] == list(BAND_SEEDS)
    assert not set(BAND_SEEDS) & set(SEEDS)
    assert made["machine"]
    assert {"python", "torch", "numpy"} <= set(made["versions"])
    for task, agents in published()["figures"].items():
        assert {"ppo", "random"} <= set(agents), task
        for agent in agents:
            runs = published_figures(task, agent)
            assert runs is not None
            assert runs.shape == (10, 7)
    ppo, random = (published_figures(FOUR_ROOMS, agent) for agent in ("ppo", "random"))
    assert ppo is not None
    assert random is not None
    assert ppo[:, 4].mean() > random[:, 4].mean() + 0.05
    with pytest.raises(ValueError, match="agent with a published band 'pp'"):
        published_figures(FOUR_ROOMS, "pp")


def test_ppo_is_in_its_band() -> None:
    verdicts = list(check_agent("ppo", tasks=[ANY, OBSERVATION]))
    assert [one.sentence for one in verdicts] == ["in the band"] * 2


def flipped(ratio: Tensor, advantages: Tensor, clip_range: float) -> Tensor:
    return policy_loss(ratio, -advantages, clip_range)


def test_a_ppo_with_flipped_advantages_is_out_of_the_band(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ppo, "_policy_loss", flipped)
    [verdict] = check_agent("ppo", tasks=[OBSERVATION])
    assert not verdict.passed
    assert verdict.outside[4] == "below"
    assert verdict.figures[4] < 0


@pytest.mark.slow
def test_a_ppo_with_flipped_advantages_is_out_of_the_band_of_four_rooms(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ppo, "_policy_loss", flipped)
    [verdict] = check_agent("ppo", tasks=[FOUR_ROOMS])
    assert not verdict.passed


@pytest.mark.slow
@pytest.mark.parametrize("agent", sorted(published()["figures"][FOUR_ROOMS]))
def test_each_reference_agent_is_in_its_bands(agent: str) -> None:
    verdicts = list(check_agent(agent))
    assert {one.task: one.sentence for one in verdicts} == dict.fromkeys((one.task for one in verdicts), "in the band")


def test_an_agent_that_does_not_learn_is_out_of_every_band_of_a_probe() -> None:
    chance = published_figures(OBSERVATION, "random")
    assert chance is not None
    for agent in set(published()["figures"][OBSERVATION]) - {"random"}:
        runs = published_figures(OBSERVATION, agent)
        assert runs is not None
        band = band_of(runs, len(SEEDS), usual_deviation(OBSERVATION))
        assert band.outside(chance.mean(axis=0)), agent


def test_random_is_in_its_own_band_and_out_of_ppos() -> None:
    verdicts = {like: list(check_agent("random", like=like, tasks=[OBSERVATION])) for like in ("random", "ppo")}
    assert verdicts["random"][0].passed
    assert set(verdicts["ppo"][0].outside.values()) == {"below"}


def test_runs_are_kept_where_that_is_asked_for(tmp_path: Path) -> None:
    list(check_agent("random", tasks=[ANY], out=tmp_path))
    assert len(list(tmp_path.rglob("record.json"))) == len(SEEDS)


def test_the_command_checks_a_port(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """One's own random agent, held against ours."""
    (tmp_path / "port.py").write_text("from sprl_baselines.random_policy import random as mine\n")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sys.path", [*__import__("sys").path])
    words: list[Any] = ["check-agent", "port:mine", "--like", "random", "--task", ANY, "--task", OBSERVATION]
    assert main(words) == 0
    printed = capsys.readouterr()
    assert f"{OBSERVATION} (chance 0.00, best 1.00): in the band." in printed.out
    assert "port:mine is in the band of random on 2 of 2 tasks." in printed.out
    assert f"Training on {ANY}, seed 0: 2,000 env steps." in printed.err
    assert main(["check-agent", "port:mine", "--like", "ppo", "--task", OBSERVATION]) == 1
    assert "OUT OF THE BAND: below it at 0 to 20 %" in capsys.readouterr().out
    assert main(["check-agent", "port:mine"]) == 2
    assert "Unknown agent with a published band 'port:mine'" in capsys.readouterr().err
