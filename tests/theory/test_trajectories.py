"""The theory against enumeration on random worlds, and against answers found by hand."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import sprl_bench  # noqa: F401 - registers the ids
import theory_plots
from sprl_bench import solver, theory
from sprl_bench.envs.grid.encoding import AGENT, EMPTY, GOAL, KEY, WALL

KS = (0, 1, 2, 3, 5, 10)
LEFT, RIGHT, FORWARD = range(3)
Model = Callable[[Any], theory.World]


@st.composite
def worlds(draw: st.DrawFn) -> theory.World:
    """Random tables, disconnected, with loops on the spot and parallel edges; any number of goals, even the start."""
    states, actions = draw(st.integers(1, 6)), draw(st.integers(1, 3))
    state = st.integers(0, states - 1)
    table = draw(st.lists(st.lists(state, min_size=actions, max_size=actions), min_size=states, max_size=states))
    goal = draw(st.lists(st.booleans(), min_size=states, max_size=states))
    return theory.World(np.array(table), np.array(goal), draw(state))


def line(start: int, length: int = 5, goal: int | None = 4) -> theory.World:
    """Cells in a row, moves left and right; at the ends, nothing moves."""
    cells = np.arange(length)
    successors = np.stack([np.maximum(cells - 1, 0), np.minimum(cells + 1, length - 1)], axis=1)
    return theory.World(successors, cells == goal, start)


def room(size: int = 2, direction: int = 0) -> np.ndarray:
    """One room, the agent in its upper left corner and the goal in its lower right one."""
    observation = np.zeros((size + 2, size + 2, 3), np.uint8)
    observation[..., 0] = WALL
    observation[1:-1, 1:-1, 0] = EMPTY
    observation[1, 1] = AGENT, 0, direction
    observation[-2, -2, 0] = GOAL
    return observation


def four_rooms(seed: int) -> np.ndarray:
    return gymnasium.make("SPRL/FourRooms-7x7-v1").reset(seed=seed)[0]


def follow(world: theory.World, actions: tuple[int, ...] | list[int]) -> list[int]:
    """Return the states that these actions lead through."""
    states = [world.start]
    for action in actions:
        states.append(int(world.successors[states[-1], action]))
    return states


def enumerate_leaves(world: theory.World, horizon: int) -> list[list[int]]:
    """Return all trajectories of `horizon` steps, and the shorter ones that end on the goal, by trying everything."""
    leaves = {}
    for actions in itertools.product(range(world.successors.shape[1]), repeat=horizon):
        states = follow(world, actions)
        length = next((t for t, state in enumerate(states) if world.goal[state]), horizon)
        leaves[actions[:length]] = states[: length + 1]
    return list(leaves.values())


def floyd_warshall(world: theory.World) -> np.ndarray:
    """Return the distances by another algorithm."""
    states = len(world.successors)
    table = np.full((states, states), np.inf)
    for state in np.flatnonzero(~world.goal):
        table[state, world.successors[state]] = 1
    np.fill_diagonal(table, 0)
    for middle in range(states):
        table = np.minimum(table, table[:, [middle]] + table[[middle]])
    return np.where(np.isinf(table), -1, table).astype(int)


@given(worlds())
def test_distances_are_those_of_another_algorithm(world: theory.World) -> None:
    assert theory.distances(world).tolist() == floyd_warshall(world).tolist()
    assert theory.num_reachable(world) == (floyd_warshall(world)[world.start] >= 0).sum()


@given(worlds(), st.integers(0, 6), st.integers(0, 5))
@settings(max_examples=200)
def test_counts_are_those_of_enumeration(world: theory.World, k: int, horizon: int) -> None:
    table = floyd_warshall(world)
    counts = theory.count_trajectories(world, k, horizon)
    nodes = 0
    for steps in range(horizon + 1):
        leaves = [each for each in enumerate_leaves(world, steps) if theory.is_admissible(each, table, k)]
        assert counts.trajectories[steps] == len(leaves)
        assert counts.running[steps] == sum(not world.goal[each[-1]] for each in leaves)
        assert counts.ended[steps] == sum(bool(world.goal[each[-1]]) and len(each) == steps + 1 for each in leaves)
        nodes += counts.running[steps] + counts.ended[steps]
        assert counts.tree_sizes[steps] == nodes


@given(worlds(), st.integers(0, 8))
def test_shares_never_rise_with_k(world: theory.World, horizon: int) -> None:
    shares = np.array([theory.shares(world, k, horizon) for k in range(8)])
    assert (shares[0] == 1).all()
    assert (np.diff(shares, axis=0) <= 0).all()
    assert (shares >= 0).all()


@given(worlds())
def test_all_shortest_paths_to_the_goal_survive_for_every_k(world: theory.World) -> None:
    table = theory.distances(world)
    lengths = [length for length in table[world.start, world.goal] if length >= 0]
    if not lengths:
        with pytest.raises(ValueError, match="world has no reachable goal"):
            theory.shortest_path(world)
        return
    path, nearest = theory.shortest_path(world), min(lengths)
    assert (path[0], len(path) - 1, bool(world.goal[path[-1]])) == (world.start, nearest, True)
    assert all(after in world.successors[state] for state, after in itertools.pairwise(path))
    everything = theory.count_trajectories(world, 0, nearest).ended
    assert everything[:nearest] == (0,) * nearest
    for k in range(8):
        assert theory.is_admissible(path, table, k)
        assert theory.count_trajectories(world, k, nearest).ended == everything


@given(worlds(), st.integers(0, 6))
def test_with_k_beyond_all_distances_nothing_but_shortest_paths_is_left(world: theory.World, horizon: int) -> None:
    table = theory.distances(world)
    farthest = max(0, *table[world.start])
    counts = theory.count_trajectories(world, len(world.successors), farthest + horizon)
    assert not any(counts.running[farthest + 1 :])
    for steps, ended in enumerate(counts.ended):
        assert (ended > 0) == bool((table[world.start, world.goal] == steps).any())


def test_the_predicate_on_a_line() -> None:
    table = theory.distances(line(2))
    assert all(theory.is_admissible([0, 1, 2, 3, 4], table, k) for k in KS)
    assert [theory.is_admissible([2, 1, 2], table, k) for k in KS] == [True, True, False, False, False, False]
    assert [theory.is_admissible([0, 0, 1], table, k) for k in KS] == [True, False, False, False, False, False]
    assert theory.is_admissible([3], table, 10)
    assert theory.is_admissible([3, 4, 3], table, 0)
    assert not theory.is_admissible([3, 4, 3], table, 1)  # nothing comes after the goal


def test_counts_on_a_line_by_hand() -> None:
    unconstrained, one, two = (theory.count_trajectories(line(2), k, 4) for k in (0, 1, 2))
    assert (unconstrained.running, unconstrained.ended) == ((1, 2, 3, 6, 10), (0, 0, 1, 0, 2))
    assert (one.running, one.ended) == ((1, 2, 3, 5, 8), (0, 0, 1, 0, 2))  # no step against the wall
    assert (two.running, two.ended) == ((1, 2, 1, 0, 0), (0, 0, 1, 0, 0))  # and no turning back
    assert two.trajectories == (1, 2, 2, 1, 1)
    assert two.tree_sizes == (1, 3, 5, 5, 5)
    assert theory.shares(line(2), 2, 4) == [1, 1, 2 / 4, 1 / 7, 1 / 13]


def test_counts_in_a_room_of_four_cells_by_hand() -> None:
    world = theory.cardinal_world(room())
    unconstrained, one, two = (theory.count_trajectories(world, k, 2) for k in (0, 1, 2))
    assert (unconstrained.running, unconstrained.ended) == ((1, 4, 14), (0, 0, 2))  # two moves of four meet a wall
    assert (one.running, one.ended) == ((1, 2, 2), (0, 0, 2))
    assert (two.running, two.ended) == ((1, 2, 0), (0, 0, 2))
    assert theory.shares(world, 2, 2) == [1, 2 / 4, 2 / 16]
    assert theory.num_reachable(world) == 4


def test_poses_in_a_room_of_four_cells_by_hand() -> None:
    world = theory.pose_world(room())
    assert len(world.successors) == 16
    assert theory.num_reachable(world) == 14  # the goal is entered to the right or downwards
    assert theory.shortest_path(world) == follow(world, [FORWARD, RIGHT, FORWARD])
    facing_up = theory.pose_world(room(direction=3))
    assert len(theory.shortest_path(facing_up)) - 1 == 4  # a turn more
    assert follow(facing_up, [FORWARD, FORWARD]) == [facing_up.start] * 3


def test_circling_in_a_room_is_pruned_from_five_steps_on() -> None:
    """Forward and left by turns goes on for ever; five such steps make a pose that left, forward, left makes too."""
    world = theory.pose_world(room(size=4))
    world = theory.World(world.successors, np.zeros_like(world.goal), start=4 * 5 + 3)  # in the middle, without a goal
    circle, table = follow(world, [FORWARD, LEFT] * 8), theory.distances(world)
    assert [theory.is_admissible(circle, table, k) for k in range(1, 8)] == [True] * 4 + [False] * 3
    assert table[circle[0], circle[5]] == 3


@pytest.mark.parametrize("seed", range(8))
def test_four_rooms_has_twenty_cells_and_the_solvers_distances(seed: int) -> None:
    observation = four_rooms(seed)
    cells, poses = theory.cardinal_world(observation), theory.pose_world(observation)
    assert (len(cells.successors), cells.goal.sum()) == (20, 1)
    assert (len(poses.successors), poses.goal.sum()) == (80, 4)
    assert theory.num_reachable(cells) <= 20  # a goal in a gap shuts it
    assert theory.num_reachable(theory.World(cells.successors, np.zeros(20, np.bool_), cells.start)) == 20
    assert len(theory.shortest_path(poses)) - 1 == solver.distances_to_goal(observation[None])[0]
    assert len(theory.shortest_path(cells)) <= len(theory.shortest_path(poses))


def test_poses_move_as_the_environment_does() -> None:
    env = gymnasium.make("SPRL/FourRooms-7x7-v1")
    rng, ended = np.random.default_rng(0), 0
    for seed in range(30):
        world = theory.pose_world(env.reset(seed=seed)[0])
        state, free = world.start, np.flatnonzero(env.unwrapped.gen_obs()[..., 0] != WALL)
        for _ in range(99):
            action = int(rng.integers(3))
            observation, _, terminated, _, _ = env.step(action)
            state = int(world.successors[state, action])
            now = solver.parse(observation[None])
            assert (free[state // 4], state % 4) == (now.agent[0], now.direction[0])
            assert terminated == world.goal[state]
            if terminated:
                ended += 1
                break
    assert ended


@pytest.mark.parametrize("model", [theory.cardinal_world, theory.pose_world])
def test_on_four_rooms_a_larger_k_prunes_more_and_keeps_the_shortest_paths(model: Model) -> None:
    for seed in range(3):
        world = model(four_rooms(seed))
        nearest = len(theory.shortest_path(world)) - 1
        counts = [theory.count_trajectories(world, k, 20) for k in KS]
        leaves = [each.trajectories[20] for each in counts]
        assert leaves == sorted(leaves, reverse=True)
        assert len(set(leaves)) >= 5  # on the cells of 7x7, k = 3 and k = 5 may leave the same
        assert leaves[-1] / leaves[0] < 1e-8
        assert len({each.ended[nearest] for each in counts}) == 1
        assert counts[-1].ended[nearest] > 0


def test_the_figures_of_the_page() -> None:
    cells, poses = theory.cardinal_world(four_rooms(3)), theory.pose_world(four_rooms(3))
    assert [theory.count_trajectories(cells, k, 20).tree_sizes[20] for k in KS] == [
        1_339_870_958_589, 144_376_506, 4_667, 145, 145, 29,
    ]  # fmt: skip
    assert [theory.count_trajectories(poses, k, 20).tree_sizes[20] for k in KS] == [
        5_046_481_987, 432_260_204, 1_492_700, 290_198, 251, 116,
    ]  # fmt: skip


def test_large_counts_are_exact() -> None:
    counts = theory.count_trajectories(line(2, goal=None), 0, 200)
    assert counts.trajectories[200] == 2**200
    assert counts.tree_sizes[200] == 2**201 - 1


def test_steps_to_the_goal_have_the_expectations_found_by_hand() -> None:
    """A walk from the wall takes n (n + 1) steps on average, n n if it never bumps, and n if it never turns."""
    for k, mean in ((0, 20), (1, 16), (2, 4)):
        steps = theory.steps_to_goal(line(0), k, np.random.default_rng(0), episodes=4000)
        assert steps.mean() == pytest.approx(mean, abs=4 * steps.std() / 4000**0.5)
        assert steps.min() == 4
    steps = theory.steps_to_goal(line(2), 2, np.random.default_rng(0))
    assert set(steps) == {2, 6}  # at once, or by way of the wall, where it forgets and turns
    assert 0.45 < (steps == 2).mean() < 0.55


def test_walks_are_seeded_and_may_give_up() -> None:
    world = theory.pose_world(four_rooms(0))
    first, again, other = (
        theory.steps_to_goal(world, 3, np.random.default_rng(seed), episodes=20).tolist() for seed in (1, 1, 2)
    )
    assert first == again != other
    trapped = theory.World(np.array([[0], [1]]), np.array([False, True]), 0)
    assert theory.steps_to_goal(trapped, 3, np.random.default_rng(0), episodes=2, limit=7).tolist() == [7, 7]
    there = theory.World(np.array([[0]]), np.array([True]), 0)
    assert theory.steps_to_goal(there, 3, np.random.default_rng(0), episodes=2).tolist() == [0, 0]


def test_bad_arguments_are_answered_in_one_sentence() -> None:
    table, goal = np.array([[0, 1], [1, 0]]), np.array([False, True])
    with pytest.raises(ValueError, match=r"successors is from 0 to 2; it must be states from 0 to 1\."):
        theory.World(np.array([[0, 2], [1, 0]]), goal, 0)
    with pytest.raises(ValueError, match=r"successors is float64 \[2, 2\]; it must be int64 \[S, A\]\."):
        theory.World(table.astype(float), goal, 0)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match=r"goal is .*; it must be an array bool \(2,\)"):
        theory.World(table, goal[:1], 0)
    with pytest.raises(ValueError, match="start is 2; it must be an integer from 0 to 1"):
        theory.World(table, goal, 2)
    with pytest.raises(ValueError, match="k is -1; it must be an integer of at least 0"):
        theory.count_trajectories(line(0), -1, 3)
    with pytest.raises(ValueError, match="horizon is -1; it must be an integer of at least 0"):
        theory.count_trajectories(line(0), 1, -1)
    with_key = room(size=3)
    with_key[2, 2, 0] = KEY
    with pytest.raises(ValueError, match="has a key or a door"):
        theory.cardinal_world(with_key)


def test_the_same_map_gives_the_same_picture(tmp_path: Path) -> None:
    pictures = []
    for name in ("first", "second"):
        path = tmp_path / f"{name}.svg"
        theory_plots.plot_theory(four_rooms(3), path, ks=(0, 2), horizon=5, episodes=5)
        pictures.append(path.read_bytes())
    assert pictures[0] == pictures[1]
    with pytest.raises(ValueError, match="suffix"):
        theory_plots.plot_theory(four_rooms(3), tmp_path / "theory.jpeg")


def test_the_picture_holds_the_shares_and_names_every_k() -> None:
    figure = theory_plots.draw_theory(four_rooms(3), ks=(0, 1, 3, 5), horizon=12, episodes=5)
    cells, poses, steps = (axes for axes in figure.axes if axes.get_title())
    assert [axes.get_yscale() for axes in (cells, poses, steps)] == ["log", "log", "linear"]
    lines = cells.get_lines()
    assert list(lines[2].get_ydata()) == theory.shares(theory.cardinal_world(four_rooms(3)), 3, 12)
    names = {text.get_text() for text in cells.texts}
    assert {"k = 0 (all)", "k = 1", "k = 3, 5"} <= names
    assert len(steps.containers) == 2  # one line with its intervals for each model
