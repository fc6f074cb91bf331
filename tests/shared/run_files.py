"""The files of runs without what may differ between equal runs: times and memory."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, Final

from safetensors import safe_open

from sprl_bench.records.folder import ACTIONS, EPISODES, METRICS, RECORD, SPEC, WEIGHTS

# Of a record: how long it took, and what its process had loaded, which in a test is more.
CHANGING: Final = ("wall_time_s", "peak_memory_mib", "versions")
LASTING: Final = {RECORD, EPISODES, METRICS, SPEC, WEIGHTS, ACTIONS}


def files_of(out: Path) -> dict[str, Any]:
    """Return all files below a folder: content, of records without their times, of metrics without theirs."""
    return {str(path.relative_to(out)): _content(path) for path in sorted(out.rglob("*")) if path.is_file()}


def _content(path: Path) -> Any:
    if path.name == RECORD:
        data = json.loads(path.read_bytes())
        return {name: value for name, value in data.items() if name not in CHANGING}
    if path.name == METRICS:
        lines = [json.loads(line) for line in path.read_bytes().splitlines()]
        return [{name: value for name, value in line.items() if name != "wall_time_s"} for line in lines]
    if path.name == WEIGHTS:  # the order of a safetensors header is not fixed; the digest is of all content
        with safe_open(path, framework="numpy") as file:
            return file.metadata()
    return path.read_bytes()
