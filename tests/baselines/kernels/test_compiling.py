"""How kernels are compiled."""

from __future__ import annotations

from typing import Any

import pytest

from sprl_baselines.kernels import compiling as module


def test_without_a_folder_to_cache_in_it_is_compiled_all_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    def njit(**options: Any) -> Any:
        if options.get("cache"):
            raise RuntimeError("cannot cache function: no locator available")
        return lambda function: ("compiled", function)

    monkeypatch.setattr(module, "njit", njit)
    assert module.kernel(len) == ("compiled", len)
