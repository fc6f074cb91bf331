"""The command line: each command is one public function and the words around it.

A mistake becomes one line on stderr and an exit status: 2 where the command was wrong, 1 where something failed. A bug
of ours keeps its traceback, as every error does with `--debug`.
"""

from __future__ import annotations

from sprl_bench.cli.app import main

__all__ = ["main"]
