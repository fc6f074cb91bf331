"""The layouts: facts of DeepMind Lab's levels, and the generator itself where it is installed."""

from __future__ import annotations

import os
from collections import deque

import numpy as np
import pytest

from sprl_bench.envs.maze.directions import COSINES, DIRECTIONS, SCALE_BITS, SINES
from sprl_bench.envs.maze.levels import CORRIDOR, GENERATORS, LEVELS, NUM_LAYOUTS, PLACE, SPAWN, WALL
from sprl_bench.envs.maze.maze_bank import bank_file, from_text, layouts, pack

SEEDS = int(os.environ.get("SPRL_MAZE_SEEDS", "500"))  # compared with the generator; at most 10,000


def rooms(layout: np.ndarray) -> list[np.ndarray]:
    """Return the cells [K, 2] of each room: connected cells of rooms, row and column."""
    left = {tuple(cell) for cell in np.argwhere(layout > CORRIDOR)}
    found = []
    while left:
        room, waiting = [], deque([left.pop()])
        while waiting:
            y, x = waiting.popleft()
            room.append((y, x))
            for neighbour in ((y + 1, x), (y - 1, x), (y, x + 1), (y, x - 1)):
                if neighbour in left:
                    left.remove(neighbour)
                    waiting.append(neighbour)
        found.append(np.array(room))
    return found


def reached(layout: np.ndarray) -> int:
    """Return how many cells can be reached from the first free one."""
    start = tuple(np.argwhere(layout != WALL)[0])
    seen, waiting = {start}, deque([start])
    while waiting:
        y, x = waiting.popleft()
        for neighbour in ((y + 1, x), (y - 1, x), (y, x + 1), (y, x - 1)):
            if layout[neighbour] != WALL and neighbour not in seen:
                seen.add(neighbour)
                waiting.append(neighbour)
    return len(seen)


@pytest.mark.parametrize("name", LEVELS)
def test_layouts_are_those_of_the_generator(name: str) -> None:
    labmaze = pytest.importorskip("labmaze", reason="labmaze has wheels up to Python 3.12")
    bank = layouts(name)
    for seed in range(SEEDS):
        maze = labmaze.RandomMaze(**GENERATORS[name], random_seed=seed)
        np.testing.assert_array_equal(bank[seed], from_text(str(maze.entity_layer), str(maze.variations_layer)))


@pytest.mark.parametrize(
    ("name", "size", "most_rooms", "sides", "spawns", "places"),
    [("GoalSmall", 11, 4, {3, 5}, 5, 4), ("GoalLarge", 17, 9, {3}, 5, 4), ("ObjectMany", 13, 1, {11}, 5, 16)],
)
def test_layouts_have_the_facts_of_their_level(
    name: str, size: int, most_rooms: int, sides: set[int], spawns: int, places: int
) -> None:
    """The generator is asked for 5 goals in GoalLarge, but 9 cells have room for 4 beside the starts."""
    bank = layouts(name)
    assert bank.shape == (NUM_LAYOUTS, size, size)
    assert not bank[:, [0, -1]].any()
    assert not bank[:, :, [0, -1]].any()
    assert len(np.unique(bank.reshape(NUM_LAYOUTS, -1), axis=0)) == NUM_LAYOUTS
    for layout in bank[:: NUM_LAYOUTS // 200]:
        found = rooms(layout)
        assert 1 <= len(found) <= most_rooms
        assert reached(layout) == (layout != WALL).sum()
        for room in found:
            height, width = np.ptp(room, axis=0) + 1
            assert {height, width} <= sides
            assert len(room) == height * width
            kinds = layout[tuple(room.T)]
            assert ((kinds == SPAWN).sum(), (kinds == PLACE).sum()) == (spawns, places)


def test_goal_mazes_have_their_full_number_of_rooms_most_of_the_time() -> None:
    for name, most in (("GoalSmall", 4), ("GoalLarge", 9)):
        counts = [len(rooms(layout)) for layout in layouts(name)[:200]]
        assert np.median(counts) == most


@pytest.mark.parametrize("name", LEVELS)
def test_packing_restores_the_layouts(name: str, monkeypatch: pytest.MonkeyPatch, tmp_path: object) -> None:
    assert bank_file(name).stat().st_size < 500_000
    bank = layouts(name)
    assert not bank.flags.writeable
    repacked = layouts.__wrapped__
    monkeypatch.setattr("pathlib.Path.read_bytes", lambda self: pack(bank))
    np.testing.assert_array_equal(repacked(name), bank)


def test_sines_are_exactly_rounded() -> None:
    angles = np.arange(DIRECTIONS) * 2 * np.pi / DIRECTIONS
    np.testing.assert_array_equal(SINES, np.rint(np.sin(angles) * 2**SCALE_BITS))
    np.testing.assert_array_equal(COSINES, np.rint(np.cos(angles) * 2**SCALE_BITS))
