"""The picture: rays against exact fractions, pixels against a plain drawing in floats, and fixed hashes."""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
from fractions import Fraction
from pathlib import Path

import gymnasium
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import sprl_bench  # noqa: F401 - registers the ids
from sprl_bench.envs import MAZE_IDS as IDS
from sprl_bench.envs.maze import raycast
from sprl_bench.envs.maze.directions import DIRECTIONS
from sprl_bench.envs.maze.levels import BAD, CORRIDOR, GOAL, LEVELS, NOTHING, WALL
from sprl_bench.envs.maze.maze_bank import layouts
from sprl_bench.envs.maze.motion import CELL
from sprl_bench.envs.maze.textures import PATTERNS, TEXELS

ROOT = Path(__file__).parents[3]
NEAR_CORNER = Fraction(1, 500)  # of a cell: there an exact ray and a rounded one may part


def exact_hit(
    cells: np.ndarray, x: Fraction, y: Fraction, ray_x: Fraction, ray_y: Fraction
) -> tuple[Fraction, int, int, bool]:
    """Return depth and cell of the first wall on a ray, and whether the ray passes near a corner before."""
    crossings = []
    for number in range(len(cells) + 1):
        for axis, ray, start in ((0, ray_x, x), (1, ray_y, y)):
            if ray and ((depth := (number - start) / ray) > 0 or (depth == 0 and ray < 0)):
                crossings.append((depth, axis, number))
    near = False
    for depth, axis, number in sorted(crossings):
        other = y + depth * ray_y if axis == 0 else x + depth * ray_x
        near |= abs(other - round(other)) < NEAR_CORNER
        step = ray_x if axis == 0 else ray_y
        cell = (number if step > 0 else number - 1, int(other)) if axis == 0 else (
            int(other), number if step > 0 else number - 1
        )  # fmt: skip
        if cells[cell[1], cell[0]] == WALL:
            return depth, *cell, near
    raise AssertionError("the border is all wall")


poses = st.tuples(
    st.sampled_from(sorted(LEVELS)),
    st.integers(0, 200),
    st.integers(0, 10**6),
    st.integers(0, CELL - 1),
    st.integers(0, CELL - 1),
    st.integers(0, DIRECTIONS - 1),
)


@given(pose=poses, column=st.integers(0, raycast.SIDE - 1))
@settings(max_examples=300)
def test_a_ray_ends_at_the_first_wall(pose: tuple[str, int, int, int, int, int], column: int) -> None:
    level, index, which, part_x, part_y, angle = pose
    cells = layouts(level)[index]
    free = np.argwhere(cells != WALL)
    cell_y, cell_x = free[which % len(free)].tolist()
    x, y = cell_x * CELL + part_x, cell_y * CELL + part_y
    ray_x, ray_y = (int(part) for part in raycast.ray_of(angle, column))
    hit = raycast.cast(cells[None], 0, x, y, ray_x, ray_y)
    scale = 1 << raycast.RAY_BITS
    depth, wall_x, wall_y, near = exact_hit(
        cells, Fraction(x, CELL), Fraction(y, CELL), Fraction(ray_x, scale), Fraction(ray_y, scale)
    )
    assert cells[hit.y, hit.x] == WALL
    if not near:
        assert (hit.x, hit.y) == (wall_x, wall_y)
        assert abs(hit.depth - depth * CELL) <= 2 * len(cells)


def test_rays_span_ninety_degrees() -> None:
    for angle in (0, 700, 2048, 4000):
        rays = np.array([raycast.ray_of(angle, column) for column in range(raycast.SIDE)]) / 2**raycast.RAY_BITS
        ahead = np.array([np.cos(angle * 2 * np.pi / DIRECTIONS), np.sin(angle * 2 * np.pi / DIRECTIONS)])
        np.testing.assert_allclose(rays @ ahead, 1, atol=1e-3)
        aside = rays @ np.array([-ahead[1], ahead[0]])
        np.testing.assert_allclose(aside, (np.arange(raycast.SIDE) * 2 + 1 - raycast.SIDE) / raycast.SIDE, atol=1e-3)


def plain_picture(cells: np.ndarray, pose: np.ndarray, look: np.ndarray, fog: bool) -> np.ndarray:
    """Draw floor, ceiling and walls pixel by pixel, in floats."""
    picture = np.zeros((84, 84, 3))
    x, y, angle = pose[0] / CELL, pose[1] / CELL, pose[2] * 2 * np.pi / DIRECTIONS
    for column in range(84):
        across = (2 * column + 1 - 84) / 84
        ray_x = np.cos(angle) - np.sin(angle) * across
        ray_y = np.sin(angle) + np.cos(angle) * across
        exact = [Fraction(float(value)) for value in (x, y, ray_x, ray_y)]
        depth, wall_x, wall_y, _ = exact_hit(cells, *exact)
        wall = float(depth)
        hit_x, hit_y = x + wall * ray_x, y + wall * ray_y
        is_x_side = min(abs(hit_x - wall_x), abs(hit_x - wall_x - 1)) < min(
            abs(hit_y - wall_y), abs(hit_y - wall_y - 1)
        )
        for line in range(84):
            rise = (42 - line - 0.5) / 42  # above the eye, at a depth of one cell
            if abs(rise) * wall > 0.5:
                far = 0.5 / abs(rise)
                number = raycast.CEILING_SURFACE if rise > 0 else raycast.FLOOR_SURFACE
                place, light = (x + far * ray_x, y + far * ray_y), 1.0
            else:
                far, light = wall, 1.0 if is_x_side else 200 / 256
                side = (0 if ray_x > 0 else 1) if is_x_side else (2 if ray_y > 0 else 3)
                hit = raycast.Hit(0, wall_x, wall_y, side)
                number = raycast._surface(cells[None], 0, hit, int(look[raycast.LOOK_KEY]))
                place = (hit_y if is_x_side else hit_x, 0.5 - rise * wall)
            pattern, *colour = look[number * 4 : number * 4 + 4]
            u, v = (min(int((value % 1) * TEXELS), TEXELS - 1) for value in place)
            dark = max(1 - far / 4, 0) if fog else 1.0
            picture[line, column] = PATTERNS[pattern, u, v] / 256 * np.array(colour) * light * dark
    return picture


@pytest.mark.parametrize("fog", [False, True])
@pytest.mark.parametrize("env_id", IDS)
def test_pictures_are_those_of_a_plain_drawing(env_id: str, fog: bool) -> None:
    """Rounding moves the borders of texels a little, so a few pixels differ."""
    envs = gymnasium.make_vec(env_id, 4, fog=fog)
    envs.reset(seed=11)
    rng = np.random.default_rng(0)
    for _ in range(20):
        envs.step(rng.integers(8, size=4))
    worlds = envs.mazes.worlds
    worlds.things[..., 2] = NOTHING
    envs.mazes.restore()
    for row in range(4):
        expected = plain_picture(worlds.cells[row], worlds.poses[row], worlds.looks[row], fog)
        differences = abs(envs.mazes.frames[row] - expected).max(axis=-1)
        assert (differences <= 4).mean() > 0.97


def scene(x: float, y: float, angle: int, things: list[tuple[int, int, int]], fog: bool = False) -> np.ndarray:
    """Draw a room of 5 x 5 without patterns, grey, with these things."""
    cells = np.full((1, 7, 7), CORRIDOR, np.uint8)
    cells[0, [0, -1]] = cells[0, :, [0, -1]] = WALL
    cells[0, 3, 4] = WALL
    looks = np.full((1, raycast.LOOK_VALUES), 100)
    looks[0, 0::4] = 0
    frames = np.zeros((1, 84, 84, 3), np.uint8)
    pose = np.array([[int(x * CELL), int(y * CELL), angle, 0, 0]])
    raycast.draw(frames, raycast.new_columns(), cells, pose, np.array([things]), looks, 0, fog)
    return frames[0]


def difference(things: list[tuple[int, int, int]], **view: float) -> np.ndarray:
    """Return which pixels things change, bool [84, 84]."""
    where = {"x": 1.5, "y": 1.5, "angle": 0, **view}
    return (scene(**where, things=things) != scene(**where, things=[(1, 1, NOTHING)])).any(axis=-1)  # type: ignore[arg-type]


def test_a_thing_is_seen_in_the_middle_when_it_is_ahead_and_larger_when_it_is_near() -> None:
    near, far = difference([(2, 1, GOAL)]), difference([(5, 1, GOAL)])
    assert near.sum() > 5 * far.sum() > 0
    for seen in (near, far):
        lines, columns = np.nonzero(seen)
        assert abs(lines.mean() - 41.5) < 1
        assert abs(columns.mean() - 41.5) < 1


def test_a_thing_to_the_right_is_seen_to_the_right_and_one_behind_not_at_all() -> None:
    assert np.nonzero(difference([(3, 2, BAD)]))[1].min() > 42
    assert not difference([(2, 1, GOAL)], angle=DIRECTIONS // 2).any()


def test_a_wall_hides_a_thing() -> None:
    assert difference([(3, 3, GOAL)], x=2.0, y=3.5).any()
    assert not difference([(5, 3, GOAL)], x=2.0, y=3.5).any()


def test_the_nearer_thing_covers_the_farther_in_any_order() -> None:
    one, other = (2, 1, GOAL), (3, 1, BAD)
    first, second = scene(1.5, 1.5, 0, [one, other]), scene(1.5, 1.5, 0, [other, one])
    np.testing.assert_array_equal(first, second)
    assert first[41, 41, 0] > first[41, 41, 2]  # red before violet


def test_fog_hides_what_is_far() -> None:
    assert scene(1.5, 1.5, 0, [(5, 1, GOAL)])[42, 42].max() > 100
    assert scene(1.5, 1.5, 0, [(5, 1, GOAL)], fog=True)[42, 42].max() < 60
    assert scene(1.2, 1.5, 0, [(1, 1, NOTHING)], fog=True)[40, 42].max() == 0


HASHES = {
    "SPRL/MazeGoalSmall-v1": ("3071061e0afac88d", "73064c522aa5fd6e"),  # without fog, with it
    "SPRL/MazeGoalLarge-v1": ("49148fae23ef3c01", "b4c75b09e3f26a23"),
    "SPRL/MazeObjectMany-v1": ("cffdee7acf2f0ac2", "8333de17f6f20daf"),
}


@pytest.mark.parametrize("fog", [False, True])
@pytest.mark.parametrize("env_id", IDS)
def test_every_processor_draws_the_same_bits(env_id: str, fog: bool) -> None:
    envs = gymnasium.make_vec(env_id, 16, fog=fog)
    digest = hashlib.sha256(envs.reset(seed=0)[0].tobytes())
    actions = np.arange(200 * 16).reshape(200, 16) * 2654435761 % 2**32 // 2**16 % 8
    for chosen in actions:
        observations, rewards, *_ = envs.step(chosen)
        digest.update(observations.tobytes() + rewards.tobytes())
    digest.update(envs.mazes.worlds.poses.tobytes())
    assert digest.hexdigest()[:16] == HASHES[env_id][fog]


@pytest.mark.slow
def test_a_processor_without_vector_instructions_draws_them_too(tmp_path: Path) -> None:
    """Compile for the oldest processors, without any code that was compiled for this one."""
    environment = {
        **os.environ,
        "NUMBA_CPU_NAME": "generic",
        "NUMBA_CPU_FEATURES": "",
        "NUMBA_CACHE_DIR": str(tmp_path),
    }
    chosen = f"{__file__}::test_every_processor_draws_the_same_bits"
    subprocess.run([sys.executable, "-m", "pytest", "-q", chosen], env=environment, cwd=ROOT, check=True)
