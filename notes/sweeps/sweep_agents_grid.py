"""How the preset `tuned` of the grids is chosen: the same number of settings for every agent.

The runs are declared here and in notes/agents-sweep.md before they are made. To make them, or to continue:
`python notes/sweeps/sweep_agents_grid.py runs/agents-sweep`. Agents named behind the folder are the only ones run.
"""

from __future__ import annotations

import itertools
import sys
from pathlib import Path
from typing import Any

from sprl_bench.suggestions import unknown
from sweeps import Setting, Sweep

BUDGETS = {"KeyDoors-7x7": 1_000_000, "FourRooms-7x7": 250_000}
SEEDS = (10,)  # none of those that entries are made of


def crossed(**values: tuple[Any, Any]) -> list[Setting]:
    """Return the four settings that two values of each of two hyperparameters give; the paper's come first."""
    return [dict(zip(values, chosen, strict=True)) for chosen in itertools.product(*values.values())]


SETTINGS = {
    "ppo": crossed(learning_rate=(0.003, 0.001), entropy_coefficient=(0.01, 0.02)),
    "icm": crossed(bonus_weight=(0.1, 1.0), forward_share=(0.8, 0.2)),
    "gt-grid": crossed(learning_rate=(0.003, 0.001), bonus_weight=(0.01, 0.03)),
    "eco": crossed(bonus_weight=(0.001, 0.005), k=(3, 5)),
    "sprl": crossed(learning_rate=(0.01, 0.003), cost_scale=(0.002, 0.01)),
    "gt-sprl": crossed(learning_rate=(0.01, 0.003), cost_scale=(0.002, 0.01)),
}
SWEEPS = {agent: Sweep(agent, settings, "grid-7x7", BUDGETS, SEEDS) for agent, settings in SETTINGS.items()}


def main(root: Path, *agents: str) -> None:
    """Run the sweep of these agents, or of all, and print every AUC, the best setting of each agent first.

    Raises:
        ValueError: There is no sweep of such an agent.
    """
    for agent in agents:
        if agent not in SWEEPS:
            raise ValueError(unknown("agent", agent, SWEEPS))
    for agent in agents or SWEEPS:
        SWEEPS[agent].run(root, workers=2)
    for agent in agents or SWEEPS:
        print(SWEEPS[agent].report(root))


if __name__ == "__main__":
    main(Path(sys.argv[1]), *sys.argv[2:])
