"""GT-Grid: first visits on walks made by hand, over resets and cuts, and on the solver's paths through KeyDoors."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import gymnasium
import numpy as np
import pytest
import torch
from gymnasium import spaces
from hypothesis import given
from hypothesis import strategies as st
from torch import Tensor

import sprl_bench  # noqa: F401 - registers the ids
from sprl_baselines.bonus import Setting
from sprl_baselines.gt_grid import GTGrid, GTGridConfig
from sprl_baselines.learning.collector import Collector, Decision
from sprl_baselines.learning.rollout import Rollout
from sprl_bench import solver

CPU = torch.device("cpu")
SIZE = 5
GRID = spaces.Box(0, 255, (SIZE, SIZE, 3), np.uint8)
ACTIONS = spaces.Discrete(7)
Cell = tuple[int, int]
Walk = list[list[Cell]]  # of one sub-env: its episodes, each the cells from the first to the true successor of the last

A, B, C, D = (1, 1), (2, 1), (1, 2), (3, 3)


def gt_grid(num_envs: int, **hyperparameters: Any) -> GTGrid:
    return GTGrid(Setting(GRID, ACTIONS, num_envs, 0, CPU), GTGridConfig(**hyperparameters))


def walked(*walks: Walk) -> Rollout:
    """Return the rollout in which each sub-env makes its walk, all of the same number of steps.

    The last episode of a walk is cut by the end of the rollout and goes on in the next; `[cell]` alone is an episode
    that has just begun.
    """
    steps = [
        [(now, then, last and not open_) for now, then, last, open_ in _steps(walk)] for walk in walks
    ]  # [N][T] of (cell, next cell, ended)
    before, after, ended = (
        torch.tensor([[step[part] for step in row] for row in steps]).transpose(0, 1) for part in range(3)
    )
    shape = ended.shape
    zeros, grids = torch.zeros(shape), torch.zeros(*shape, SIZE, SIZE, 3, dtype=torch.uint8)
    return Rollout(
        observations=grids,
        actions=zeros.long(),
        rewards=zeros,
        terminated=ended & (torch.arange(shape[0]) % 2 == 0)[:, None],  # either way of ending is an ending
        truncated=ended & (torch.arange(shape[0]) % 2 == 1)[:, None],
        values=zeros,
        log_probs=zeros,
        last_observations=grids[0],
        final_observations=torch.zeros(int(ended.sum()), SIZE, SIZE, 3, dtype=torch.uint8),
        positions=before,
        next_positions=after,
    )


def _steps(walk: Walk) -> list[tuple[Cell, Cell, bool, bool]]:
    """Return (cell, next cell, whether that ends its list, whether its episode stays open) for each step."""
    return [
        (now, then, place == len(episode) - 2, number == len(walk) - 1)
        for number, episode in enumerate(walk)
        for place, (now, then) in enumerate(pairwise(episode))
    ]


def visits(bonus: GTGrid, *walks: Walk) -> list[list[float]]:
    """Return the rewards, sub-env by sub-env."""
    return bonus.reward(walked(*walks)).T.tolist()


def test_a_cell_pays_at_its_first_visit_only() -> None:
    """Onward, back to the start, standing still, and on."""
    assert visits(gt_grid(1, bonus_weight=1.0), [[A, B, A, A, C, B, D]]) == [[1, 0, 0, 1, 0, 1]]


def test_the_weight_is_table_1s() -> None:
    assert visits(gt_grid(1), [[A, B, B]]) == [[pytest.approx(0.01), 0]]


def test_the_true_successor_at_the_end_counts_and_the_next_episode_starts_afresh() -> None:
    """B was visited in the first episode and pays again; C, where the second one starts, does not."""
    bonus = gt_grid(1, bonus_weight=1.0)
    assert visits(bonus, [[A, B, D], [C, B, C, D, A]]) == [[1, 1, 1, 0, 1, 1]]


def test_a_known_final_cell_pays_nothing() -> None:
    assert visits(gt_grid(1, bonus_weight=1.0), [[A, B, A], [A, B]]) == [[1, 0, 1]]


def test_each_sub_env_has_its_own_memory() -> None:
    bonus = gt_grid(2, bonus_weight=1.0)
    assert visits(bonus, [[A, B, A, B]], [[B], [A, D], [A, B, A]]) == [[1, 0, 0], [1, 1, 0]]


def test_an_episode_goes_on_over_a_cut_and_not_beyond_its_end() -> None:
    bonus = gt_grid(1, bonus_weight=1.0)
    assert visits(bonus, [[A, B, C]]) == [[1, 1]]
    assert visits(bonus, [[C, B, A, D], [A]]) == [[0, 0, 1]]  # ends with the rollout
    assert visits(bonus, [[A, D, B, A]]) == [[1, 1, 0]]


cells = st.tuples(st.integers(0, 2), st.integers(0, 2))
walks = st.lists(st.lists(cells, min_size=2, max_size=9), min_size=1, max_size=4)


@given(walks, st.integers(1, 30))
def test_first_visits_against_sets(walk: Walk, at: int) -> None:
    """Every episode of a walk, in one rollout and in two, against a set of cells for each."""
    expected = []
    for episode in walk:
        seen = {episode[0]}
        for cell in episode[1:]:
            expected.append(float(cell not in seen))
            seen.add(cell)
    whole = walked([*walk, [A]])
    assert gt_grid(1, bonus_weight=1.0).reward(whole)[:, 0].tolist() == expected
    bonus = gt_grid(1, bonus_weight=1.0)
    parts = [_part(whole, slice(at)), _part(whole, slice(at, None))]
    assert [reward for part in parts for reward in bonus.reward(part)[:, 0].tolist()] == expected


def _part(rollout: Rollout, steps: slice) -> Rollout:
    """Return some steps; observations are left as they are, as the bonus does not read them."""
    fields = {name: getattr(rollout, name) for name in Rollout.__dataclass_fields__}
    for name in ("rewards", "terminated", "truncated", "positions", "next_positions"):
        fields[name] = fields[name][steps]
    return Rollout(**fields)


# ------------------------------------------------------------------------------------------ KeyDoors


def shortest_paths(observations: Tensor) -> Decision:
    zeros = torch.zeros(len(observations))
    return Decision(torch.from_numpy(solver.optimal_actions(observations.numpy())), zeros, zeros)


@pytest.fixture(scope="module")
def key_doors() -> Rollout:
    """Shortest paths to the goal, several episodes in each sub-env."""
    envs = gymnasium.make_vec("SPRL/KeyDoors-7x7-v1", num_envs=8)
    envs.reset(seed=0)
    collector = Collector(envs, 120, CPU)
    collector.reset()
    rollout = collector.collect(shortest_paths)
    assert rollout.terminated.any(dim=0).all()
    return rollout


def in_key_doors() -> GTGrid:
    single = gymnasium.make("SPRL/KeyDoors-7x7-v1")
    setting = Setting(single.observation_space, single.action_space, 8, 0, CPU)
    return GTGrid(setting, GTGridConfig(bonus_weight=1.0))


def test_only_moves_can_be_new(key_doors: Rollout) -> None:
    paid = in_key_doors().reward(key_doors).bool()
    moved = key_doors.actions == 2
    assert paid[moved].any()
    assert not paid[~moved].any()
    assert paid[key_doors.terminated].all()  # the goal's cell, which is new at each end


# --------------------------------------------------------------------------------------------- Fetch


def in_fetch(length: int, **hyperparameters: Any) -> GTGrid:
    space = spaces.Box(-np.inf, np.inf, (length,), np.float64)
    return GTGrid(Setting(space, spaces.Box(-1, 1, (4,)), 1, 0, CPU), GTGridConfig(**hyperparameters))


def moved(length: int, *states: list[float]) -> Rollout:
    """Return the rollout of one sub-env through these states, which are filled up with noise."""
    noise = torch.from_numpy(np.random.default_rng(0).normal(size=(len(states), 1, length)))
    for row, state in zip(noise[:, 0], states, strict=True):
        row[: len(state)] = torch.tensor(state, dtype=torch.float64)
    zeros = torch.zeros(len(states) - 1, 1)
    nowhere = torch.empty(len(states) - 1, 1, 0, dtype=torch.int64)
    return Rollout(
        observations=noise[:-1],
        actions=zeros,
        rewards=zeros,
        terminated=zeros.bool(),
        truncated=zeros.bool(),
        values=zeros,
        log_probs=zeros,
        last_observations=noise[-1],
        final_observations=noise[:0, 0],
        positions=nowhere,
        next_positions=nowhere,
    )


def test_a_cube_of_the_gripper_pays_at_its_first_visit() -> None:
    """Within a cube, to the next along x, back, below zero along y, and to the next along z."""
    states = [
        [1.01, 0.01, 0.5],
        [1.04, 0.04, 0.54],
        [1.06, 0.01, 0.5],
        [1.01, 0.01, 0.5],
        [1.01, -0.01, 0.5],
        [1, 0, 0.6],
    ]
    bonus = in_fetch(16, bonus_weight=1.0)
    assert bonus.reward(moved(16, *states))[:, 0].tolist() == [0, 1, 0, 1, 1]
    assert in_fetch(16, bonus_weight=1.0, cube_size=2.0).reward(moved(16, *states))[:, 0].tolist() == [0, 0, 0, 1, 0]


def test_with_an_object_its_cube_counts_too() -> None:
    here, there = [1.01, 0.51, 0.51], [1.06, 0.51, 0.51]
    states = [here + here, here + there, there + there, there + here, here + there]
    assert in_fetch(31, bonus_weight=1.0).reward(moved(31, *states))[:, 0].tolist() == [1, 1, 1, 0]
    states = [[9e9, 0, 0], [-9e9, 0, 0], [9e9, 0, 0]]  # far outside, all cubes beyond an end are one
    assert in_fetch(16, bonus_weight=1.0).reward(moved(16, *states))[:, 0].tolist() == [1, 0]


@pytest.mark.parametrize(("task", "coordinates"), [("Reach", 3), ("Push", 6)])
def test_on_fetch_against_a_set_of_rounded_coordinates(task: str, coordinates: int) -> None:
    envs = gymnasium.make_vec(f"SPRL/Fetch{task}Sparse-v1", num_envs=1, substep=100)
    envs.reset(seed=0)
    collector = Collector(envs, 60, CPU)
    collector.reset()
    rollout = collector.collect(lambda _: Decision(torch.rand(1, 4) * 2 - 1, torch.zeros(1), torch.zeros(1)))
    seen: set[tuple[int, ...]] = set()
    expected = []
    for step in range(60):
        seen.add(tuple((rollout.observations[step, 0, :coordinates] / 0.05).floor().int().tolist()))
        after = tuple((rollout.next_observations[step, 0, :coordinates] / 0.05).floor().int().tolist())
        expected.append(float(after not in seen))
        if rollout.ended[step]:
            seen.clear()
    setting = Setting(envs.single_observation_space, envs.single_action_space, 1, 0, CPU)
    assert GTGrid(setting, GTGridConfig(bonus_weight=1.0)).reward(rollout)[:, 0].tolist() == expected
    assert 5 < sum(expected) < 60


# -------------------------------------------------------------------------------------- wrong spaces


@pytest.mark.parametrize("shape", [(16,), (5, 7, 3), (5, 5, 1)])
def test_observations_without_cells_are_refused(shape: tuple[int, ...]) -> None:
    space = spaces.Box(0, 255, shape, np.uint8)
    with pytest.raises(ValueError, match=r"observation_space is Box.*; it must be \(S, S, 3\)"):
        GTGrid(Setting(space, ACTIONS, 1, 0, CPU), GTGridConfig())


def test_an_env_that_reports_no_position_is_refused() -> None:
    rollout = walked([[A, B]])
    fields = {name: getattr(rollout, name) for name in Rollout.__dataclass_fields__}
    nowhere = torch.empty(1, 1, 0, dtype=torch.int64)
    with pytest.raises(ValueError, match=r"positions has the shape \(1, 1, 0\); it must be \(T, N, 2\)"):
        gt_grid(1).reward(Rollout(**{**fields, "positions": nowhere, "next_positions": nowhere}))
