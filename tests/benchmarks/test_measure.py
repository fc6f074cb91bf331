"""Contenders in processes of their own, what is made of their rates, and the table: never how fast anything is."""

from __future__ import annotations

import os
import sys
from math import isnan
from pathlib import Path

import pytest

import contender_fakes
from benchmarks.__main__ import main
from benchmarks.contenders import Contender, Process, contender, optional
from benchmarks.measure import Row, compare, table
from contender_fakes import above_another, broken, limited, steady

LINUX = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="memory is read where Linux keeps it")


@pytest.fixture(autouse=True)
def _fakes_in_children(monkeypatch: pytest.MonkeyPatch) -> None:
    fakes = str(Path(contender_fakes.__file__).parent)
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(filter(None, [fakes, os.environ.get("PYTHONPATH")])))


def test_the_ratio_is_that_of_the_rates() -> None:
    row = compare(
        "twice the steps",
        contender(steady, steps=2, seconds=0.05),
        "as long",
        contender(steady, steps=1, seconds=0.05),
        bar=1,
        repeats=3,
    )
    assert row.ours == pytest.approx(40, rel=0.5)
    assert row.ratio == pytest.approx(2, rel=0.5)
    assert row.verdict == ""


@LINUX
def test_peak_memory_is_that_of_the_contender_and_of_what_it_started() -> None:
    small, large = contender(steady, steps=1, seconds=0), contender(steady, steps=1, seconds=0, megabytes=200)
    with Process(small) as one, Process(large) as other, Process(contender(above_another, megabytes=200)) as above:
        one.turn(), other.turn(), above.turn()
    assert other.peak - one.peak == pytest.approx(200e6, rel=0.2)
    assert above.peak - one.peak > 150e6


def test_a_contender_that_fails_is_named() -> None:
    with Process(contender(broken)) as process, pytest.raises(RuntimeError, match=r"contender_fakes:broken .* stopped"):
        process.turn()


@pytest.mark.skipif(not hasattr(os, "sched_setaffinity"), reason="this system keeps no process to some cores")
def test_jax_is_kept_to_its_cores() -> None:
    with Process(contender(limited, num_cores=1)) as process:
        assert process.turn() == pytest.approx(100, rel=0.5)  # one core in a hundredth of a second


def test_what_is_not_installed_is_not_measured() -> None:
    theirs = optional("no_such_module", "no-such-package", steady)
    for row in (
        compare("ours", contender(broken), "theirs", theirs, bar=2),
        compare("ours", theirs, "theirs", contender(broken), bar=2),
    ):
        assert row.verdict == "Not measured"
        assert row.against == "theirs (needs no-such-package: `make bench` installs it)"
    assert optional("os", "no-such-package", steady).lacks == ""


def test_a_contender_may_have_an_interpreter_of_its_own() -> None:
    made = Contender(steady, {"steps": 1}, python="/elsewhere/python")
    assert made.command == ["/elsewhere/python", "-m", "benchmarks.turns", "contender_fakes:steady", '{"steps": 1}']


def test_the_table_is_aligned_and_has_no_figure_where_nothing_was_measured() -> None:
    measured = Row("fast", "slow", 1.5, 12_345, 1000, 12.345, 250e6, 1.25e9)
    assert table([measured, Row("a", "b", 1000)]).splitlines() == [
        "what  against  ours, steps/s  theirs, steps/s         ratio     bar  our peak, MB  their peak, MB",
        "fast  slow            12,345            1,000        12.35x    1.5x           250           1,250",
        "a     b                    -                -  not measured  1,000x             -               -",
    ]


def test_a_row_says_whether_its_bar_is_reached() -> None:
    assert Row("a", "b", 2, ratio=2).verdict == ""
    assert Row("a", "b", 2, ratio=1.99).verdict == "Below its bar"
    assert isnan(Row("a", "b", 2).ratio)


def test_an_unknown_benchmark_is_refused_before_any_is_run(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["grid", "fetch-lerner"]) == 2
    assert "Unknown benchmark 'fetch-lerner'; did you mean 'fetch-learner'? Allowed: " in capsys.readouterr().err
