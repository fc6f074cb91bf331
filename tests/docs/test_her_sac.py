"""The script for SAC with hindsight experience replay: it trains, and its record is that of the budget."""

from __future__ import annotations

import runpy
import sys
from pathlib import Path

import pytest
from pages import ROOT

from sprl_bench.records import RunRecord, read
from sprl_bench.records.folder import RECORD, run_path


def test_the_script_trains_and_is_recorded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    options = {"--budget": "1100", "--seed": "7", "--out": str(tmp_path), "--discount-per": "reference-action"}
    monkeypatch.setattr(sys, "argv", ["her_sac.py", *(word for option in options.items() for word in option)])
    runpy.run_path(str(ROOT / "docs" / "her_sac.py"), run_name="__main__")
    folder = tmp_path / run_path("custom", "FetchReach-substep2-1100", "her-sac-per-reference-action", 7)
    record = read(folder / RECORD, RunRecord)
    assert record.status == "complete"
    assert record.spec.information == ("relabelling",)
    assert record.spec.hyperparameters["gamma"] == pytest.approx(0.95**0.1)
