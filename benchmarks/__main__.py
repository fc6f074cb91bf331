"""Measure every row, or those of the files named: `python -m benchmarks grid fetch-learner`, say."""

from __future__ import annotations

import sys

from benchmarks import agents, atari, fetch, fetch_learner, grid, learner, maze, overhead, sb3_adapter, workers
from benchmarks.measure import table
from sprl_bench.suggestions import unknown

ROOMS = {
    "agents": agents.rows,
    "atari": atari.rows,
    "fetch": fetch.rows,
    "fetch-learner": fetch_learner.rows,
    "grid": grid.rows,
    "learner": learner.rows,
    "maze": maze.rows,
    "overhead": overhead.rows,
    "sb3-adapter": sb3_adapter.rows,
    "workers": workers.rows,
}


def main(names: list[str]) -> int:
    """Print one table; return 2 for an unknown name."""
    for name in names:
        if name not in ROOMS:
            print(unknown("benchmark", name, ROOMS), file=sys.stderr)
            return 2
    rows = [row for name in names or ROOMS for row in ROOMS[name]()]
    print(table(rows))
    for row in rows:
        if row.verdict:
            print(f"{row.verdict}: {row.what}, against {row.against}.")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
