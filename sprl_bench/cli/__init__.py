"""The command line: each command calls one public function.

An error is shown as one line on stderr; the exit status is 2 for a wrong command and 1 for a failure. A bug in this
package shows its traceback, and with `--debug` every error does.
"""

from __future__ import annotations

from sprl_bench.cli.app import main

__all__ = ["main"]
