"""The two studies with figures of their own: what the constraint prunes, and which walks a trained network charges."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import gymnasium
import numpy as np
import pytest

from cli_calls import Capture, call
from sprl_bench import executors
from sprl_bench.policies import restore
from sprl_bench.records import read
from sprl_bench.records.folder import RECORD, SPEC, WEIGHTS
from sprl_bench.records.types import RunSpec
from sprl_bench.studies import reduction, trajectories
from sprl_bench.studies.agent_places import STEP, place_of, room_of, screen_of
from sprl_bench.studies.trajectories import Walk, judge_walks, split, walks_of


class Here:
    """Runs in this process."""

    def map(self, function, specs):
        for spec in specs:
            yield spec, function(spec)


def walk(cost: float, *places: int) -> Walk:
    return Walk(np.array([(place, 0) for place in places]), cost)


def test_revisits_by_hand() -> None:
    assert walk(0.0, 1, 2, 3, 4).revisits == 0
    assert walk(0.0, 1, 1, 2, 1).revisits == pytest.approx(2 / 3)


def test_quarters_are_the_cheapest_and_the_dearest() -> None:
    cheap, dear = split([walk(cost / 8, 1, 2) for cost in (3, 1, 7, 0, 5, 2, 6, 4)])
    assert ([one.cost for one in cheap], [one.cost for one in dear]) == ([0, 0.125], [0.75, 0.875])
    assert split([walk(0.5, 1, 2)] * 8) == ([], [])
    assert split([walk(cost, 1, 2) for cost in (0.0, 1.0)]) == ([], [])


@pytest.mark.parametrize(
    ("cheap", "dear", "outcome"),
    [
        ((1, 2, 3), (1, 1, 1), "supported"),
        ((1, 1, 1), (1, 2, 3), "contradicted"),
        ((1, 2, 3), (4, 5, 6), "not decided"),
    ],
)
def test_the_three_verdicts_on_walks(
    cheap: Sequence[int], dear: Sequence[int], outcome: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    walks = tuple([walk(0.0, *cheap)] * 4 + [walk(0.5, *cheap)] * 8 + [walk(1.0, *dear)] * 4)
    monkeypatch.setattr(trajectories, "walks_of", lambda _folder: walks)
    assert judge_walks([Path("seed-0")]).outcome == outcome
    monkeypatch.setattr(trajectories, "walks_of", lambda _folder: walks[:4] * 4)
    assert "all have the same cost" in judge_walks([Path("seed-0")]).sentence
    assert judge_walks([]).why == "runs are missing"


def test_a_trained_run_is_judged_by_its_own_network(
    capsys: Capture, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(executors, "make_executor", lambda *_: Here())
    monkeypatch.setattr(trajectories, "WALKS", 12)
    command = ["reproduce", "fig22", "--seeds", "1", "--budget-share", "0.001", "--base", "sprl+num_envs=4"]
    status, printed, err = call(capsys, *command, "--device", "cpu", "--out", tmp_path)
    assert status == 0, err
    assert "Verdict: " in printed
    assert (tmp_path / "fig22.png").exists()
    [folder] = [path.parent for path in tmp_path.rglob(RECORD)]
    walks = walks_of(folder)
    assert walks
    assert all(6 <= len(one.positions) <= 61 for one in walks)
    assert all(0 <= one.cost <= 1 for one in walks)


TINY = (
    "sprl+num_envs=2+rollout_length=16+epochs=1+minibatches=1+k=2+negative_bias=2+replay_size=64"
    "+head_units=16+embedding_units=16+tolerance_samples=2"
)


def test_walks_in_montezumas_revenge_are_drawn_on_its_screen(
    capsys: Capture, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("ale_py")
    monkeypatch.setattr(executors, "make_executor", lambda *_: Here())
    monkeypatch.setattr(trajectories, "WALKS", 8)
    monkeypatch.setattr(trajectories, "LONGEST", 12)
    command = ["reproduce", "fig22-atari", "--seeds", "1", "--budget-share", "5e-6", "--base", TINY]
    status, printed, err = call(capsys, *command, "--device", "cpu", "--out", tmp_path)
    assert status == 0, err
    assert "Verdict: " in printed
    assert (tmp_path / "fig22-atari.png").exists()
    [folder] = [path.parent for path in tmp_path.rglob(RECORD)]
    walks = walks_of(folder)
    assert walks
    assert all(6 <= len(one.positions) <= 13 for one in walks)
    assert all(one.positions[0].tolist() == [77 // STEP, 83 // STEP] for one in walks)  # on the first platform
    background = trajectories._background(folder)
    assert background is not None
    assert background.shape == (210, 160)


def test_visits_are_drawn_where_they_were() -> None:
    from matplotlib.figure import Figure

    walks = [Walk(np.array([(3, 5), (4, 5), (4, 5)]), 0.0), Walk(np.array([(2, 2), (3, 2)]), 1.0)]
    over_area, over_screen = Figure().subplots(1, 2)
    trajectories._draw_visits(over_area, walks[:1], walks, None)
    assert over_area.images[0].get_array().tolist() == [[0, 0, 0]] * 3 + [[0, 1, 2]]
    trajectories._draw_visits(over_screen, walks[:1], walks, np.zeros((210, 160)))
    screen, visits = over_screen.images
    assert screen.get_extent() == [0, 160, 210, 0]
    left, right, bottom, top = visits.get_extent()
    counts = visits.get_array()
    assert (right - left) / counts.shape[1] == (bottom - top) / counts.shape[0] == STEP
    assert {(x, y): counts[y, x] for y, x in np.argwhere(counts.filled(0))} == {(3, 5): 1, (4, 5): 2}


def test_a_place_in_montezumas_revenge_is_where_the_screen_shows_the_agent() -> None:
    """Down the ladder and aside: where the agent was and is, the screen has changed."""
    pytest.importorskip("ale_py")
    env = gymnasium.make("SPRL/MontezumaRevenge-v1")
    observation, info = env.reset(seed=0)

    def play(action: int, steps: int) -> tuple[tuple[int, int], np.ndarray]:
        for _ in range(steps):
            env.step(action)
        return place_of(env, observation, info), screen_of(env)

    def changed(before: np.ndarray, after: np.ndarray, place: tuple[int, int]) -> int:
        x, y = (STEP * one + 1 for one in place)
        around = slice(y - 8, y + 8), slice(x - 4, x + 4)
        return int((before[around] != after[around]).sum())

    start, first = play(0, 20)
    below, second = play(5, 8)
    assert start == (77 // STEP, 83 // STEP)
    assert 40 <= STEP * (below[1] - start[1]) <= 48  # the ladder's length
    aside, third = play(4, 4)
    assert aside[0] < below[0] == start[0]
    assert abs(aside[1] - below[1]) <= 1
    assert min(changed(first, second, start), changed(first, second, below)) > 20
    assert min(changed(second, third, below), changed(second, third, aside)) > 20
    assert room_of(env) == 1
    env.close()


def test_positions_in_other_games_are_not_known() -> None:
    pytest.importorskip("ale_py")
    env = gymnasium.make("SPRL/MsPacman-v1")
    observation, info = env.reset(seed=0)
    with pytest.raises(ValueError, match=r"The game is SPRL/MsPacman-v1; it must be SPRL/MontezumaRevenge-v1"):
        place_of(env, observation, info)


def test_costs_of_a_stretch_are_those_of_training(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Capture
) -> None:
    """By exact search: standing still is charged once enough path lengths vote; a shortest path never is."""
    monkeypatch.setattr(executors, "make_executor", lambda *_: Here())
    command = ["run", "--suite", "smoke", "--agents", "gt-sprl+num_envs=4+tolerance_samples=1", "--seeds", "1"]
    assert call(capsys, *command, "--budget", "600", "--device", "cpu", "--out", tmp_path)[0] == 0
    [folder] = [path.parent for path in tmp_path.rglob(RECORD)]
    agent = restore(folder, read(folder / SPEC, RunSpec))
    env = gymnasium.make("SPRL/FourRooms-7x7-v1")
    observation, _ = env.reset(seed=0)
    costs = agent.costs(env.observation_space, env.action_space)
    assert costs(np.stack([observation] * 6)).tolist() == [0, 0, 1, 1, 1]  # k = 2, and a tolerance of 1
    from sprl_bench.solver import optimal_actions

    seen = [observation]
    for _ in range(4):
        seen.append(env.step(int(optimal_actions(seen[-1][None])[0]))[0].copy())
    assert costs(np.stack(seen)).tolist() == [0, 0, 0, 0]


def test_an_agent_without_a_cost_is_refused(capsys: Capture, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(executors, "make_executor", lambda *_: Here())
    command = ["reproduce", "fig22", "--seeds", "1", "--budget-share", "0.0005", "--base", "ppo+num_envs=4"]
    status, _, err = call(capsys, *command, "--device", "cpu", "--out", tmp_path)
    assert (status, "This agent charges no cost; it must be sprl or gt-sprl." in err) == (2, True)


def test_a_run_of_an_earlier_build_is_refused(capsys: Capture, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from sprl_bench import checkpoint

    monkeypatch.setattr(executors, "make_executor", lambda *_: Here())
    command = ["run", "--suite", "smoke", "--agents", "sprl+num_envs=4", "--seeds", "1", "--budget", "600"]
    assert call(capsys, *command, "--device", "cpu", "--out", tmp_path)[0] == 0
    [folder] = [path.parent for path in tmp_path.rglob(RECORD)]
    weights = checkpoint.load(folder / WEIGHTS)
    checkpoint.save(folder / WEIGHTS, {"agent": {"learner": weights["agent"]["learner"]}})
    with pytest.raises(ValueError, match="The weights hold no reachability network; they must be of this build"):
        walks_of(folder)


# ------------------------------------------------------------------------------------------ what is pruned


def test_the_reduction_is_counted_drawn_and_judged(capsys: Capture, tmp_path: Path) -> None:
    status, printed, _ = call(capsys, "reproduce", "sec6.6", "--out", tmp_path / "new")
    assert status == 0
    assert "Verdict: Supported: on 10 maps of FourRooms-7x7 the share never rises with k" in printed
    assert "| k = 10 |" in (tmp_path / "new" / "sec6.6.md").read_text()
    assert (tmp_path / "new" / "sec6.6.png").exists()


def test_a_share_that_rises_contradicts(monkeypatch: pytest.MonkeyPatch) -> None:
    shares, remains = reduction.counted()
    assert remains
    monkeypatch.setattr(reduction, "counted", lambda: (shares[:, ::-1], True))
    assert reduction.judge_reduction().outcome == "contradicted"
    monkeypatch.setattr(reduction, "counted", lambda: (shares, False))
    assert reduction.judge_reduction().outcome == "contradicted"
