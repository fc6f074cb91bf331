"""Where things stand at the start of an episode: the distribution, checked on observations alone."""

from __future__ import annotations

import itertools

import gymnasium
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

import sprl_bench  # noqa: F401 - registers the ids
from sprl_bench.envs.grid.encoding import AGENT, DOOR, EMPTY, GOAL, KEY, LOCKED, WALL, YELLOW
from sprl_bench.envs.grid.layouts import pick, pick_two

NUM_STARTS = 40_000
P_VALUE = 1e-4  # seeds are fixed: a right implementation either always passes or never


def starts(env_id: str, count: int = NUM_STARTS, seed: int = 0) -> np.ndarray:
    """Return first observations [count, S, S, 3] of sub-environments seeded seed, seed + 1, ..."""
    return gymnasium.make_vec(env_id, count).reset(seed=seed)[0]


def cell_of(kinds: np.ndarray, kind: int) -> np.ndarray:
    """Return (y, x) [count, 2] of the one cell of a kind in each grid; fails unless there is exactly one."""
    found = np.argwhere(kinds == kind)
    assert (found[:, 0] == np.arange(len(kinds))).all()
    return found[:, 1:]


def assert_uniform(values: np.ndarray, expected: int) -> None:
    """Check that `values` (rows) take `expected` distinct values, all equally often."""
    _, counts = np.unique(values, axis=0, return_counts=True)
    assert len(counts) == expected
    assert stats.chisquare(counts).pvalue > P_VALUE


def assert_independent(features: dict[str, np.ndarray]) -> None:
    """Check that no two features tell anything about each other."""
    for (name, one), (other_name, other) in itertools.combinations(features.items(), 2):
        joint = stats.contingency.crosstab(one, other).count
        assert stats.chi2_contingency(joint).pvalue > P_VALUE, (name, other_name)


def assert_outer_wall(kinds: np.ndarray) -> None:
    for edge in (kinds[:, 0], kinds[:, -1], kinds[:, :, 0], kinds[:, :, -1]):
        assert (edge == WALL).all()


@pytest.mark.parametrize("size", [7, 11])
def test_four_rooms_have_one_uniform_gap_in_each_arm_and_nothing_else(size: int) -> None:
    kinds = starts(f"SPRL/FourRooms-{size}x{size}-v1")[..., 0]
    middle, arm = size // 2, size // 2 - 1
    assert_outer_wall(kinds)
    assert (kinds[:, middle, middle] == WALL).all()
    arms = np.stack(
        [
            kinds[:, 1:middle, middle], kinds[:, middle + 1 : -1, middle],
            kinds[:, middle, 1:middle], kinds[:, middle, middle + 1 : -1],
        ], axis=1,
    )  # fmt: skip
    assert ((arms != WALL).sum(axis=2) == 1).all()
    assert_uniform((arms != WALL).argmax(axis=2), arm**4)
    inside = kinds[:, 1:-1, 1:-1]
    assert ((inside == WALL).sum(axis=(1, 2)) == 4 * arm - 4 + 1).all()
    assert ((inside == EMPTY).sum(axis=(1, 2)) == 4 * arm**2 + 4 - 2).all()


@pytest.mark.parametrize("size", [7, 11])
def test_four_rooms_agent_and_goal_are_uniform_over_distinct_free_cells(size: int) -> None:
    observations = starts(f"SPRL/FourRooms-{size}x{size}-v1", seed=10**6)
    kinds = observations[..., 0]
    agent, goal = cell_of(kinds, AGENT), cell_of(kinds, GOAL)
    assert_uniform(observations[np.arange(len(agent)), agent[:, 0], agent[:, 1], 2][:, None], 4)
    # The rank of a cell among the free cells, row by row, is a number that the layout code never forms.
    free = (kinds != WALL).reshape(len(kinds), -1)
    rank = free.cumsum(axis=1) - 1
    num_free = 4 * (size // 2 - 1) ** 2 + 4
    first, second = (rank[np.arange(len(kinds)), cell[:, 0] * size + cell[:, 1]] for cell in (agent, goal))
    assert_uniform(first[:, None], num_free)
    assert_uniform(second[:, None], num_free)
    assert_uniform(((second - first) % num_free)[:, None], num_free - 1)


def test_four_rooms_draws_are_independent() -> None:
    observations = starts("SPRL/FourRooms-7x7-v1", seed=2 * 10**6)
    kinds = observations[..., 0]
    count = np.arange(len(kinds))
    agent, goal = cell_of(kinds, AGENT), cell_of(kinds, GOAL)
    rank = (kinds != WALL).reshape(len(kinds), -1).cumsum(axis=1) - 1
    first, second = (rank[count, cell[:, 0] * 7 + cell[:, 1]] for cell in (agent, goal))
    assert_independent(
        {
            "gap up": (kinds[:, 1:3, 3] != WALL).argmax(axis=1),
            "gap down": (kinds[:, 4:6, 3] != WALL).argmax(axis=1),
            "gap left": (kinds[:, 3, 1:3] != WALL).argmax(axis=1),
            "gap right": (kinds[:, 3, 4:6] != WALL).argmax(axis=1),
            "agent": first,
            "direction": observations[count, agent[:, 0], agent[:, 1], 2],
            "goal, seen from the agent": (second - first) % 20,
        }
    )


def test_key_doors_draws_are_independent_given_the_wall() -> None:
    observations = starts("SPRL/KeyDoors-7x7-v1", seed=2 * 10**6)
    kinds = observations[..., 0]
    agent, key, goal, door = (cell_of(kinds, kind) for kind in (AGENT, KEY, GOAL, DOOR))
    direction = observations[np.arange(len(kinds)), agent[:, 0], agent[:, 1], 2]
    for column in (2, 3, 4):
        here = door[:, 1] == column
        first, second = (cell[here][:, 0] - 1 + 5 * (cell[here][:, 1] - 1) for cell in (agent, key))
        assert_independent(
            {
                "door": door[here][:, 0],
                "agent": first,
                "direction": direction[here],
                "key, seen from the agent": (second - first) % (5 * (column - 1)),
                "goal": goal[here][:, 0] * 7 + goal[here][:, 1],
            }
        )
    assert_independent({"wall": door[:, 1], "door": door[:, 0], "direction": direction})


@pytest.mark.parametrize("size", [7, 11])
def test_key_doors_have_one_wall_with_one_locked_yellow_door(size: int) -> None:
    observations = starts(f"SPRL/KeyDoors-{size}x{size}-v1")
    kinds = observations[..., 0]
    assert_outer_wall(kinds)
    door = cell_of(kinds, DOOR)
    assert (observations[np.arange(len(door)), door[:, 0], door[:, 1]] == (DOOR, YELLOW, LOCKED)).all()
    assert_uniform(door, (size - 4) * (size - 2))
    assert set(door[:, 1]) == set(range(2, size - 2))
    columns = (kinds[:, 1:-1, 1:-1] == WALL).sum(axis=1)
    expected = np.zeros_like(columns)
    expected[np.arange(len(door)), door[:, 1] - 1] = size - 3
    np.testing.assert_array_equal(columns, expected)


@pytest.mark.parametrize("size", [7, 11])
def test_key_doors_agent_and_key_are_uniform_on_the_left_and_the_goal_on_the_right(size: int) -> None:
    observations = starts(f"SPRL/KeyDoors-{size}x{size}-v1", seed=10**6)
    kinds = observations[..., 0]
    rows = np.arange(len(kinds))
    agent, key, goal = (cell_of(kinds, kind) for kind in (AGENT, KEY, GOAL))
    wall = cell_of(kinds, DOOR)[:, 1]
    assert (observations[rows, key[:, 0], key[:, 1], 1] == YELLOW).all()
    assert_uniform(observations[rows, agent[:, 0], agent[:, 1], 2][:, None], 4)
    for column in range(2, size - 2):
        here = wall == column
        assert_uniform(agent[here], (column - 1) * (size - 2))
        assert_uniform(key[here], (column - 1) * (size - 2))
        assert_uniform(goal[here], (size - 2 - column) * (size - 2))
        assert agent[here][:, 1].max() < column < goal[here][:, 1].min()
        assert key[here][:, 1].max() < column
    narrow = wall == 2  # one column of S - 2 cells: all ordered pairs, equally often
    assert_uniform(np.stack([agent[narrow][:, 0], key[narrow][:, 0]], axis=1), (size - 2) * (size - 3))


@given(st.floats(0, 1, exclude_max=True), st.integers(1, 200))
def test_a_choice_is_the_floor_of_the_draw_times_the_number_of_choices(uniform: float, count: int) -> None:
    choice = pick(uniform, count)
    assert 0 <= choice < count
    assert choice <= uniform * count < choice + 1


def test_two_choices_are_all_ordered_pairs_once() -> None:
    pairs = {pick_two((a + 0.5) / 5, (b + 0.5) / 4, 5) for a in range(5) for b in range(4)}
    assert pairs == {(a, b) for a in range(5) for b in range(5) if a != b}
