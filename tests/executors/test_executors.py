"""How an executor is chosen."""

from __future__ import annotations

import sys
from typing import Any

import pytest

from sprl_bench.executors import Resources, make_executor


@pytest.mark.parametrize(
    ("name", "workers", "message"),
    [
        ("lokal", 1, "Unknown executor 'lokal'; did you mean 'local'"),
        ("local", -1, "workers is -1; it must be an integer of at least 0"),
        ("local", 1.5, "workers is 1.5"),
    ],
)
def test_a_bad_executor_is_named(name: str, workers: Any, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        make_executor(name, workers)


@pytest.mark.parametrize(("name", "module"), [("ray", "ray"), ("slurm", "submitit")])
def test_a_missing_extra_says_how_to_get_it(name: str, module: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(ModuleNotFoundError, match=rf"pip install -c constraints.txt 'sprl-bench\[{name}\]'"):
        make_executor(name, 1)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"cores": -1}, "cores is -1; it must be at least 0"),
        ({"gpu_share": 0}, "gpu_share is 0; it must be above 0 and at most 1"),
        ({"gpu_share": 1.5}, "gpu_share is 1.5; it must be above 0 and at most 1"),
        ({"memory_gib": -2.0}, "memory_gib is -2.0; it must be at least 0"),
    ],
)
def test_bad_resources_are_named(given: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Resources(**given)


def test_resources_are_for_clusters() -> None:
    with pytest.raises(ValueError, match="executor is 'local'; it must be 'ray' or 'slurm' for resources"):
        make_executor("local", 1, Resources(cores=2))
