"""Calls of the command line in this process: what came of them."""

from __future__ import annotations

import pytest

from sprl_bench.cli import main

Capture = pytest.CaptureFixture[str]


def call(capsys: Capture, *words: object) -> tuple[int, str, str]:
    """Return the exit status, what was printed, and what was complained of."""
    status = main([str(word) for word in words])
    out, err = capsys.readouterr()
    return status, out, err


def refused(capsys: Capture, *words: object) -> tuple[int, str]:
    """Return the exit status and the one line on stderr; nothing else may have been printed."""
    status, out, err = call(capsys, *words)
    assert status != 0
    assert out == ""
    assert err.count("\n") == 1, err
    assert err.startswith("sprl-bench: ")
    assert "Traceback" not in err
    return status, err.removeprefix("sprl-bench: ").rstrip("\n")
