"""`python -m sprl_bench` is the command `sprl-bench`."""

from __future__ import annotations

import sys

from sprl_bench.cli import main

if __name__ == "__main__":
    sys.exit(main())
