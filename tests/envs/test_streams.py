"""The streams in arrays against NumPy's own generator."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from gymnasium.utils import seeding
from hypothesis import example, given, settings
from hypothesis import strategies as st

from sprl_bench.envs import compiled
from sprl_bench.envs.streams import STREAM_LIMBS, fill_doubles, from_generator, seed_streams, to_generator

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


def test_the_cache_of_a_kernel_is_named_after_all_its_sources(tmp_path: Path) -> None:
    """Editing the layouts must not leave a stale kernel behind, so its name changes with any file of its folder.

    And with any of the engine's, whose functions the kernels of other folders call.
    """
    (tmp_path / "layouts.py").write_text("gap = 1")
    before = compiled.sources(tmp_path)
    (tmp_path / "layouts.py").write_text("gap = 2")
    compiled.sources.cache_clear()
    after = compiled.sources(tmp_path)
    assert after != before
    assert after != compiled.sources(tmp_path / "empty") == compiled.sources(Path(compiled.__file__).parent)
    assert fill_doubles.py_func.__qualname__.endswith(compiled.sources(Path(compiled.__file__).parent))


def test_without_a_folder_to_cache_in_kernels_still_compile(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[bool] = []

    def njit(cache: bool = False, nogil: bool = False):
        asked.append(cache)
        if cache:
            raise RuntimeError("cannot cache function: no locator available")
        return lambda function: function

    monkeypatch.setattr(compiled, "njit", njit)
    assert compiled.kernel(lambda: 3)() == 3
    assert asked == [True, False]
