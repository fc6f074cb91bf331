"""A contender in a process of its own: it takes a turn for each line that it reads, and answers with its rate.

    python -m benchmarks.turns benchmarks.grid:ours '{"num_envs": 64, "num_threads": 2}'

Only the standard library is imported here, so that a peer can run in an environment of its own.
"""

from __future__ import annotations

import importlib
import json
import os
import sys
import time
from collections.abc import Callable
from typing import IO

Turn = Callable[[], int]
"""Does a fixed piece of work and returns how many env steps it was."""


def main(builder: str, arguments: str) -> None:
    """Build the contender, and let it take turns until the input ends."""
    answers = _private_output()
    module, _, function = builder.partition(":")
    turn: Turn = getattr(importlib.import_module(module), function)(**json.loads(arguments))
    for _ in sys.stdin:
        print(rate(turn), file=answers, flush=True)


def rate(turn: Turn) -> float:
    """Return how many env steps a second one turn makes."""
    start = time.perf_counter()
    steps = turn()
    return steps / (time.perf_counter() - start)


def _private_output() -> IO[str]:
    """Return the standard output, and send to standard error whatever else is printed: pygame's greeting, say."""
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)
    return answers


if __name__ == "__main__":
    main(*sys.argv[1:])
