"""What agents logged while they trained: the lines of `metrics.jsonl`, which no score depends on."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

from pydantic_core import from_json

from sprl_bench.records.files import InvalidFileError, read, read_bytes
from sprl_bench.records.folder import METRICS, RECORD, SPEC, find_files
from sprl_bench.records.types import RunRecord, RunSpec


def find_metrics(root: Path) -> list[tuple[RunSpec, list[dict[str, Any]]]]:
    """Return the spec and the whole lines of diagnostics of each run below `root` that has any.

    Raises:
        FileNotFoundError: There is no such folder.
        InvalidFileError: A file is broken.
    """
    if not root.exists():
        raise FileNotFoundError(f"{root} does not exist.")
    found = [(_spec_in(path.parent), _lines(path)) for path in find_files(root, METRICS)]
    return [(spec, lines) for spec, lines in found if lines]


def read_metrics(folder: Path) -> list[dict[str, Any]]:
    """Return the whole lines of diagnostics in a run's folder; none if there is no such file.

    Raises:
        InvalidFileError: The file is broken.
    """
    return _lines(folder / METRICS) if (folder / METRICS).exists() else []


def _spec_in(folder: Path) -> RunSpec:
    return read(folder / SPEC, RunSpec) if (folder / SPEC).exists() else read(folder / RECORD, RunRecord).spec


def _lines(path: Path) -> list[dict[str, Any]]:
    """Return the lines of a file of metrics; the last one may not be written to its end."""
    lines = [parse_line(line) for line in read_bytes(path).split(b"\n")[:-1]]
    if not all(lines):
        raise InvalidFileError(f"{path} is broken; each line must be a JSON object of numbers, env_steps among them.")
    return lines


def parse_line(line: bytes) -> dict[str, Any]:
    """Return a line of diagnostics; empty if it is broken."""
    try:
        data = from_json(line)
    except ValueError:
        return {}
    sound = isinstance(data, dict) and all(map(_is_number, data.values())) and data.get("env_steps") is not None
    return data if sound else {}


def _is_number(value: object) -> bool:
    return value is None or (isinstance(value, int | float) and math.isfinite(value))
