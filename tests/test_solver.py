"""The solver against brute force on the real environment, and what it proves about the maps."""

from __future__ import annotations

import copy
import itertools
from collections import deque
from typing import Any

import gymnasium
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import sprl_bench  # noqa: F401 - registers the ids
from sprl_bench import solver
from sprl_bench.envs import GRID_IDS as IDS
from sprl_bench.envs.grid.encoding import AGENT, CLOSED, DONE, DOOR, EMPTY, GOAL, GREY, KEY, LOCKED, OPEN, WALL, YELLOW


def explore(env: Any, depth: int) -> dict[bytes, tuple[int, np.ndarray]]:
    """Return every observation within `depth` steps, with its distance, by stepping copies of the environment."""
    observation = env.gen_obs()
    found = {observation.tobytes(): (0, observation)}
    frontier = deque([(env, 0)] if GOAL in observation[..., 0] else [])
    while frontier:
        here, distance = frontier.popleft()
        if distance == depth:
            continue
        for action in range(7):
            after = copy.deepcopy(here)
            observation, _, terminated, _, _ = after.step(action)
            if observation.tobytes() not in found:
                found[observation.tobytes()] = (distance + 1, observation)
                if not terminated:
                    frontier.append((after, distance + 1))
    return found


def env_after(env_id: str, seed: int, actions: list[int]) -> Any:
    """Return an environment some way into an episode that is still running."""
    env = gymnasium.make(env_id).unwrapped
    env.reset(seed=seed)
    for action in actions:
        before = copy.deepcopy(env)
        if env.step(action)[2]:
            env = before
    env.step_count = 0
    return env


def grid(*rows: str) -> np.ndarray:
    """Draw an observation: # wall, . empty, k key, g goal, L locked, C closed, O open door, > v < ^ agent."""
    codes = {
        "#": (WALL, GREY, 0), ".": (EMPTY, 0, 0), "k": (KEY, YELLOW, 0), "g": (GOAL, 1, 0),
        "L": (DOOR, YELLOW, LOCKED), "C": (DOOR, YELLOW, CLOSED), "O": (DOOR, YELLOW, OPEN),
        ">": (AGENT, 0, 0), "v": (AGENT, 0, 1), "<": (AGENT, 0, 2), "^": (AGENT, 0, 3),
    }  # fmt: skip
    return np.array([[codes[letter] for letter in row] for row in rows], np.uint8)


def test_a_hand_made_key_door_takes_the_hand_counted_steps() -> None:
    """Pick up, step, open, step into the door, step out, turn right, step, step onto the goal."""
    maze = grid("######", "#>kL.#", "#..#.#", "#..#g#", "#..#.#", "######")
    assert solver.shortest_path(maze).tolist() == [3, 2, 5, 2, 2, 1, 2, 2]
    assert solver.distances_to_goal(maze[None]).tolist() == [8]
    assert solver.optimal_actions(maze[None]).tolist() == [3]


def test_parse_reads_what_shows_and_what_does_not() -> None:
    plain = grid("######", "#..#.#", "#.<#.#", "#k.L.#", "#..#g#", "######")
    carried_in_the_door = grid("######", "#..#.#", "#..#.#", "#..v.#", "#..#g#", "######")
    at_the_goal = grid("######", "#..#.#", "#..#.#", "#..C.#", "#k.#^#", "######")
    state = solver.parse(np.stack([plain, carried_in_the_door, at_the_goal]))
    assert state.agent.tolist() == [14, 21, 28]
    assert state.direction.tolist() == [2, 1, 3]
    assert state.key.tolist() == [19, 36, 25]
    assert state.door_state.tolist() == [LOCKED, OPEN, CLOSED]
    assert state.door.tolist() == [21, 21, 21]
    assert state.goal.tolist() == [28, 28, 28]


def test_four_rooms_have_neither_key_nor_door() -> None:
    observations, _ = gymnasium.make_vec(IDS[0], 500).reset(seed=0)
    state = solver.parse(observations)
    assert (state.door == -1).all()
    assert (state.key == 49).all()


def test_a_walled_in_goal_cannot_be_reached() -> None:
    maze = grid("#####", "#>.##", "#..##", "###g#", "#####")
    assert solver.distances_to_goal(maze[None]).tolist() == [-1]
    assert solver.optimal_actions(maze[None]).tolist() == [DONE]
    with pytest.raises(ValueError, match="no path"):
        solver.shortest_path(maze)


@given(
    env_id=st.sampled_from([IDS[0], IDS[2], IDS[3]]),
    seed=st.integers(0, 2**32),
    actions=st.lists(st.sampled_from([0, 1, 2, 2, 2, 3, 4, 5]), max_size=60),
)
@settings(max_examples=12, deadline=None)
def test_reachability_equals_brute_force_on_the_environment(env_id: str, seed: int, actions: list[int]) -> None:
    depth = 5
    env = env_after(env_id, seed, actions)
    source = env.gen_obs()
    found = explore(env, depth)
    targets = np.stack([observation for _, observation in found.values()])
    expected = np.array([distance for distance, _ in found.values()])
    sources = np.broadcast_to(source, targets.shape)
    np.testing.assert_array_equal(solver.distances(sources, targets), expected)
    for k in range(depth + 1):
        np.testing.assert_array_equal(solver.reachable(sources, targets, k), expected <= k)
    back = solver.distances(targets, sources)  # the way back need not exist, nor be as long: check it with brute force
    near = np.random.default_rng(seed).choice(len(targets), size=min(4, len(targets)), replace=False)
    for index in near:
        env.load(targets[index], *beneath_and_hand(source, targets[index]), elapsed=0)
        there_and_back = explore(env, 3)
        distance = there_and_back.get(source.tobytes(), (None,))[0]
        assert (back[index] if 0 <= back[index] <= 3 else None) == distance


def beneath_and_hand(before: np.ndarray, after: np.ndarray) -> tuple[np.ndarray, bool]:
    """Return the cell under the agent and whether the key is in hand, from two observations of one map."""
    state = solver.parse(np.stack([before, after]))
    agent, size = int(state.agent[1]), len(after)
    beneath = (EMPTY, 0, 0)
    if agent == state.door[0]:
        beneath = (DOOR, YELLOW, OPEN)
    elif agent == state.goal[0]:
        beneath = (GOAL, 1, 0)
    return np.array(beneath, np.uint8), bool(state.door[1] >= 0 and state.key[1] == size * size)


@given(env_id=st.sampled_from([IDS[0], IDS[2]]), seed=st.integers(0, 2**32))
@settings(max_examples=6, deadline=None)
def test_the_distance_to_the_goal_equals_brute_force_over_the_whole_state_space(env_id: str, seed: int) -> None:
    """Dropping the key is allowed here, and never pays."""
    env = env_after(env_id, seed, [])
    source = env.gen_obs()
    distance = int(solver.distances_to_goal(source[None])[0])
    if distance > 9:
        path = solver.shortest_path(source)
        for action in path[: distance - 9]:
            env.step(action)
        source, distance = env.gen_obs(), 9
        assert solver.distances_to_goal(source[None]).tolist() == [9]
    goals = [steps for steps, observation in explore(env, distance).values() if GOAL not in observation[..., 0]]
    assert min(goals) == distance


def all_layouts(size: int) -> np.ndarray:
    """Return every first observation of KeyDoors with the agent facing right."""
    height = size - 2
    grids = []
    for wall, door in itertools.product(range(2, size - 2), range(1, size - 1)):
        empty = np.full((size, size, 3), (WALL, GREY, 0), np.uint8)
        empty[1:-1, 1:-1] = (EMPTY, 0, 0)
        empty[1:-1, wall] = (WALL, GREY, 0)
        empty[door, wall] = (DOOR, YELLOW, LOCKED)
        left = list(itertools.product(range(1, height + 1), range(1, wall)))
        right = itertools.product(range(1, height + 1), range(wall + 1, size - 1))
        for (agent, key), goal in itertools.product(itertools.permutations(left, 2), right):
            cells = empty.copy()
            cells[agent], cells[key], cells[goal] = (AGENT, 0, 0), (KEY, YELLOW, 0), (GOAL, 1, 0)
            grids.append(cells)
    return np.stack(grids)


def test_every_small_key_doors_map_is_solvable_and_found_by_the_environment() -> None:
    layouts = all_layouts(7)
    distances = solver.distances_to_goal(layouts)
    assert distances.min() > 0
    assert distances.max() < 50
    assert len(layouts) == 5 * sum(
        5 * (wall - 1) * (5 * (wall - 1) - 1) * 5 * (5 - wall) for wall in range(2, 5)
    )  # fmt: skip
    observations, _ = gymnasium.make_vec(IDS[2], 3000).reset(seed=0)
    observations[observations[..., 0] == AGENT] = (AGENT, 0, 0)
    assert {cells.tobytes() for cells in observations} <= {cells.tobytes() for cells in layouts}


@pytest.mark.parametrize("env_id", IDS)
def test_every_sampled_map_is_solved_in_exactly_the_predicted_number_of_steps(env_id: str) -> None:
    envs = gymnasium.make_vec(env_id, 3000, autoreset_mode="NextStep")
    observations, _ = envs.reset(seed=5)
    predicted = solver.distances_to_goal(observations)
    assert (predicted > 0).all()
    taken = np.zeros(3000, int)
    for step in range(1, predicted.max() + 1):
        observations, rewards, terminated, _, _ = envs.step(solver.optimal_actions(observations))
        first = terminated & (taken == 0)
        taken[first] = step
        np.testing.assert_array_equal(rewards[first], 1 - 0.9 * (step / 100))
    np.testing.assert_array_equal(taken, predicted)


def test_the_path_and_the_first_actions_agree_on_the_single_environment() -> None:
    for env_id, seed in itertools.product(IDS, range(20)):
        env = gymnasium.make(env_id)
        observation, _ = env.reset(seed=seed)
        path = solver.shortest_path(observation)
        assert len(path) == solver.distances_to_goal(observation[None])[0]
        assert path[0] == solver.optimal_actions(observation[None])[0]
        flags = [env.step(action)[2] for action in path]
        assert flags == [False] * (len(path) - 1) + [True]


def test_other_maps_are_out_of_reach_and_the_goal_is_the_end() -> None:
    observations, _ = gymnasium.make_vec(IDS[0], 2).reset(seed=0)
    assert solver.reachable(observations, observations[::-1], 100).tolist() == [False, False]
    assert solver.reachable(observations, observations, 0).tolist() == [True, True]
    ahead = grid("#####", "#>g.#", "#...#", "#...#", "#####")
    on_it = grid("#####", "#.>.#", "#...#", "#...#", "#####")
    beyond = grid("#####", "#.g>#", "#...#", "#...#", "#####")
    pairs = [(ahead, on_it), (on_it, on_it), (on_it, ahead), (ahead, beyond)]
    sources, targets = (np.stack(side) for side in zip(*pairs, strict=True))
    assert solver.distances(sources, targets)[:3].tolist() == [1, 0, -1]
    assert solver.distances(sources, targets)[3] > 3  # not through the goal, where the episode ends
    assert solver.reachable(sources, targets, 1).tolist() == [True, True, False, False]


def test_a_lock_never_closes_again_and_a_key_out_of_the_way_can_be_put_back() -> None:
    locked = grid("######", "#.>L.#", "#..#.#", "#..#.#", "#..#g#", "######")
    opened, closed = locked.copy(), locked.copy()
    opened[1, 3], closed[1, 3] = (DOOR, YELLOW, OPEN), (DOOR, YELLOW, CLOSED)
    sources, targets = (
        np.stack([locked, locked, opened, closed, opened]),
        np.stack([opened, closed, closed, opened, locked]),
    )
    assert solver.distances(sources, targets).tolist() == [1, 2, 1, 1, -1]
    before = grid("######", "#>k.L#", "####.#", "####.#", "####g#", "######")
    after = grid("######", "#.k>L#", "####.#", "####.#", "####g#", "######")
    # Pick up, step twice, turn round, drop, turn round: the key lies where it lay.
    assert solver.distances(before[None], after[None]).tolist() == [8]
    assert solver.reachable(before[None], after[None], 7).tolist() == [False]


@pytest.mark.parametrize("env_id", IDS)
def test_what_the_observation_space_samples_is_refused_and_not_walked_on(env_id: str) -> None:
    space = gymnasium.make_vec(env_id, 50).observation_space
    space.seed(0)
    noise = np.random.default_rng(0).integers(0, 12, (300, 7, 7, 3)).astype(np.uint8)
    for solve in (solver.parse, solver.distances_to_goal, solver.optimal_actions):
        for observations in (space.sample(), noise):
            with pytest.raises(ValueError, match=r"^observations\[0\] is invalid: its outer border"):
                solve(observations)


@pytest.mark.parametrize(
    ("cell", "value", "message"),
    [
        ((0, 2), (EMPTY, 0, 0), "outer border"),
        ((5, 5), (AGENT, 0, 0), "outer border"),
        ((2, 2), (7, 0, 0), "an object that is neither"),
        ((2, 1), (AGENT, 0, 4), "direction"),
        ((2, 3), (DOOR, YELLOW, 3), "door's state"),
        ((2, 1), (EMPTY, 0, 0), "exactly one agent"),
        ((1, 1), (AGENT, 0, 0), "exactly one agent"),
        ((1, 1), (KEY, YELLOW, 0), "more than one key"),
        ((1, 1), (DOOR, YELLOW, OPEN), "more than one key, door"),
        ((1, 1), (GOAL, 1, 0), "more than one key, door or goal"),
    ],
)
def test_each_fault_of_a_map_is_named_with_its_row(
    cell: tuple[int, int], value: tuple[int, int, int], message: str
) -> None:
    maze = grid("######", "#..#.#", "#>kL.#", "#..#g#", "#..#.#", "######")
    mazes = np.stack([maze] * 4)
    mazes[2][cell] = value
    with pytest.raises(ValueError, match=rf"^observations\[2\] is invalid: .*{message}"):
        solver.distances_to_goal(mazes)
    with pytest.raises(ValueError, match=rf"^targets\[2\] .*{message}"):
        solver.reachable(np.stack([maze] * 4), mazes, 3)
    if cell != (2, 1):
        with pytest.raises(ValueError, match=message):
            solver.shortest_path(mazes[2])


def test_an_observation_too_small_for_a_map_is_refused() -> None:
    for size in range(3):
        with pytest.raises(ValueError, match="exactly one agent"):
            solver.distances_to_goal(np.full((1, size, size, 3), WALL, np.uint8))


@given(
    env_id=st.sampled_from([IDS[0], IDS[2], IDS[3]]),
    seed=st.integers(0, 1000),
    changes=st.lists(
        st.tuples(st.integers(0, 10**4), st.integers(0, 2), st.integers(0, 12) | st.integers(0, 255)), max_size=6
    ),
)
@settings(max_examples=150, deadline=None)
def test_a_corrupted_map_is_solved_or_refused(env_id: str, seed: int, changes: list[tuple[int, int, int]]) -> None:
    whole, _ = gymnasium.make(env_id).reset(seed=seed)
    broken = whole.copy()
    for place, channel, value in changes:
        broken.reshape(-1, 3)[place % (len(whole) ** 2), channel] = value
    try:
        distance = solver.distances_to_goal(broken[None])[0]
    except ValueError as error:
        assert str(error).startswith("observations[0] is invalid: ")  # noqa: PT017 - either will do
        return
    assert -1 <= distance < 1000
    assert solver.reachable(broken[None], broken[None], 4).tolist() == [True]
    solver.reachable(broken[None], whole[None], 4)


def test_bad_arguments_are_named() -> None:
    observations, _ = gymnasium.make_vec(IDS[0], 2).reset(seed=0)
    with pytest.raises(ValueError, match=r"observations is int64 .*; it must be uint8 \[N, S, S, 3\]"):
        solver.parse(observations.astype(np.int64))
    with pytest.raises(ValueError, match=r"observations is .*; it must be"):
        solver.parse(observations[0])
    with pytest.raises(ValueError, match="targets has shape"):
        solver.distances(observations, observations[:1])
    with pytest.raises(ValueError, match="k is -1; it must be an integer of at least 0"):
        solver.reachable(observations, observations, -1)
