"""The notebook: its cells run one after the other on the records of a few runs, and no output is kept in it."""

from __future__ import annotations

import json
from pathlib import Path

import matplotlib as mpl
import pytest
from pages import ROOT

from sprl_bench.run import run
from sprl_bench.suite import expand
from sprl_bench.tasks import find_suite

mpl.use("Agg")


def test_the_cells_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for spec in expand(find_suite("smoke"), ["random", "ppo+num_envs=6"], [0, 1], budget=1500):
        run(spec, tmp_path / "runs")
    monkeypatch.chdir(tmp_path)
    cells = json.loads((ROOT / "docs" / "frames.ipynb").read_text())["cells"]
    names: dict[str, object] = {}
    for cell in cells:
        if cell["cell_type"] == "code":
            exec(compile("".join(cell["source"]), cell["id"], "exec"), names)
            assert cell["outputs"] == []
    assert Path("my-figure.pdf").stat().st_size > 1000
