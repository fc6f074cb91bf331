"""No result depends on the order of execution: number of workers, order of the runs, executor, interruptions.

`SPRL_ORDERS` says how many orders are tried; by default few.
"""

from __future__ import annotations

import os
import random
import shutil
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from shuffled_suites import TakingTurns, results_of, run_shuffled, specs

from sprl_bench.run import run
from sprl_bench.suite import run_suite

ORDERS = int(os.environ.get("SPRL_ORDERS", "2"))


@pytest.fixture(scope="module")
def expected(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("in_order")
    for spec in specs():
        run(spec, out)
    return out


@settings(max_examples=ORDERS)
@given(
    order=st.randoms(use_true_random=False),
    workers=st.integers(1, 4),
    interruptions=st.integers(0, 2),
)
def test_turns_and_interruptions_change_nothing(
    order: random.Random, workers: int, interruptions: int, expected: Path, tmp_path_factory: pytest.TempPathFactory
) -> None:
    shuffled, out = specs(), tmp_path_factory.mktemp("turns")
    order.shuffle(shuffled)
    outcomes = run_suite(shuffled, out, executor=TakingTurns(workers, interruptions, order, out))  # type: ignore[arg-type]
    assert [one.error for one in outcomes if one.error] == []
    assert results_of(out) == results_of(expected)


@pytest.mark.parametrize(
    ("executor", "workers", "order"),
    [("local", 1 + order % 4, order) for order in range(2, 1 + ORDERS)] + [("slurm", 2, 1)],
)
def test_executors_change_nothing(executor: str, workers: int, order: int, expected: Path, tmp_path: Path) -> None:
    if executor == "slurm":
        pytest.importorskip("submitit")
    run_shuffled(executor, workers, order, tmp_path / "runs", os.environ)
    assert results_of(tmp_path / "runs") == results_of(expected)


def test_two_runs_that_changed_places_would_be_noticed(expected: Path, tmp_path: Path) -> None:
    shutil.copytree(expected, tmp_path, dirs_exist_ok=True)
    first, second = sorted(tmp_path.rglob("random/*/episodes.parquet"))[:2]
    content = first.read_bytes()
    first.write_bytes(second.read_bytes())
    second.write_bytes(content)
    assert results_of(tmp_path) != results_of(expected)
