"""The streams in arrays against NumPy's own generator."""

from __future__ import annotations

import numpy as np
from gymnasium.utils import seeding
from hypothesis import example, given, settings
from hypothesis import strategies as st

from sprl_bench.envs.streams import (
    STREAM_LIMBS,
    fill_doubles,
    from_generator,
    from_generators,
    seed_streams,
    to_generator,
    to_generators,
)

seeds = st.one_of(st.integers(0, 2**33), st.integers(0, 2**128), st.integers(0, 2**300))


@given(st.lists(seeds, min_size=1, max_size=6), st.integers(0, 40))
@example([0, 1, 2**32 - 1, 2**32, 2**64 - 1, 2**64, 2**128 - 1], 40)
@example([2**128, 2**128 + 1, 3], 3)
@settings(max_examples=300, deadline=None)
def test_a_seeded_stream_draws_what_gymnasiums_generator_draws(values: list[int], count: int) -> None:
    streams = np.zeros((len(values), STREAM_LIMBS), np.uint64)
    seed_streams(streams, np.arange(len(values)), values)
    for row, seed in zip(streams, values, strict=True):
        generator, _ = seeding.np_random(seed)
        np.testing.assert_array_equal(row, from_generator(generator))
        drawn = np.empty(count)
        fill_doubles(row, drawn)
        np.testing.assert_array_equal(drawn, generator.random(count))
        np.testing.assert_array_equal(row, from_generator(generator))


@given(st.integers(0, 2**128 - 1), st.integers(0, 2**127 - 1))
@example(2**128 - 1, 2**127 - 1)
@example(0, 0)
@settings(max_examples=300, deadline=None)
def test_any_state_of_the_generator_steps_as_numpys(state: int, half_increment: int) -> None:
    limbs = [limb for value in (state, 2 * half_increment + 1) for limb in divmod(value, 2**64)]
    row = np.array(limbs, np.uint64)
    generator = to_generator(row)
    assert generator.bit_generator.state["state"] == {"state": state, "inc": 2 * half_increment + 1}
    drawn = np.empty(5)
    fill_doubles(row, drawn)
    np.testing.assert_array_equal(drawn, generator.random(5))


def test_only_the_named_rows_are_seeded() -> None:
    streams = np.zeros((4, STREAM_LIMBS), np.uint64)
    seed_streams(streams, np.array([2, 0]), [7, 8])
    np.testing.assert_array_equal(streams[2], from_generator(np.random.default_rng(7)))
    np.testing.assert_array_equal(streams[0], from_generator(np.random.default_rng(8)))
    assert not streams[[1, 3]].any()


def test_generators_continue_from_their_rows() -> None:
    generators = [np.random.default_rng(seed) for seed in (3, 4)]
    generators[1].random(5)
    rows = from_generators(generators)
    assert rows.shape == (2, STREAM_LIMBS)
    for original, restored in zip(generators, to_generators(rows), strict=True):
        np.testing.assert_array_equal(restored.random(4), original.random(4))
