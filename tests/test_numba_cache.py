"""Compiled functions: cached under a name that all their sources decide, and compiled where nothing can be cached."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from sprl_baselines.kernels import convolution_loops
from sprl_bench import numba_cache
from sprl_bench.envs import compiled
from sprl_bench.envs.streams import fill_doubles


def test_the_name_changes_with_every_source(tmp_path: Path) -> None:
    """Editing the layouts must not leave a stale kernel behind."""
    (tmp_path / "layouts.py").write_text("gap = 1")
    before = numba_cache.sources(tmp_path, compiled.HERE)
    (tmp_path / "layouts.py").write_text("gap = 2")
    numba_cache.sources.cache_clear()
    assert numba_cache.sources(tmp_path, compiled.HERE) != before


def test_kernels_are_named_after_the_sources_that_they_are_made_of() -> None:
    tasks = numba_cache.sources(compiled.HERE, compiled.HERE / "grid", compiled.HERE / "maze")
    assert fill_doubles.py_func.__qualname__.endswith(tasks)
    learner = numba_cache.sources(Path(convolution_loops.__file__).parent)
    assert convolution_loops.forward.py_func.__qualname__.endswith(learner)


def test_without_a_folder_to_cache_in_functions_still_compile(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[dict[str, Any]] = []

    def njit(**options: Any) -> Any:
        asked.append(options)
        if options.get("cache"):
            raise RuntimeError("cannot cache function: no locator available")
        return lambda function: function

    monkeypatch.setattr(numba_cache, "njit", njit)
    assert numba_cache.compile_cached(lambda: 3, error_model="numpy")() == 3
    assert asked == [
        {"cache": True, "nogil": True, "error_model": "numpy"},
        {"nogil": True, "error_model": "numpy"},
    ]
