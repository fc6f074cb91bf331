"""What the paper swept over: the ranges of Tables 1, 2, 4 and 5. A hyperparameter with a dash there has no range here.

`learning_rate` is the policy's; ICM's own model keeps the rate of its preset. ECO and SPRL share a network in Tables 4
and 5, so both have its ranges.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

Ranges = Mapping[str, tuple[Any, ...]]

RATES = (0.001, 0.002, 0.003)
GRID: Mapping[str, Ranges] = {  # Table 1
    "eco": {"k": (3, 5, 7), "bonus_weight": (0.001, 0.002, 0.005, 0.01)},
    "gt-grid": {"learning_rate": RATES, "bonus_weight": (0.003, 0.01, 0.03, 0.1, 0.3)},
    "icm": {
        "learning_rate": RATES,
        "forward_share": (0.2, 0.5, 0.8, 1.0),
        "icm_loss_weight": (0.03, 0.1, 0.3, 1.0),
        "bonus_weight": (0.1, 0.3, 1.0, 3.0),
    },
    "ppo": {"learning_rate": RATES, "entropy_coefficient": (0.003, 0.005, 0.01, 0.02, 0.05)},
    "sprl": {
        "learning_rate": (0.003, 0.01),
        "k": (2, 5),
        "negative_bias": (10, 20),
        "cost_scale": (0.001, 0.002, 0.005),
        "tolerance_samples": (30, 60),
    },
}

DMLAB: Mapping[str, Ranges] = {  # Table 2; the other agents' settings are Savinov et al.'s
    "sprl": {"k": (3, 10, 30), "tolerance": (1, 3, 5), "negative_bias": (5, 10, 20), "cost_scale": (0.02, 0.06, 0.2)},
}

ATARI_NETWORK: Ranges = {"k": (5, 8, 12, 15), "negative_bias": (80, 100, 120)}
ATARI: Mapping[str, Ranges] = {  # Table 4
    "eco": {
        "learning_rate": (0.0001, 0.0003, 0.0005),
        "bonus_weight": (0.001, 0.003, 0.01, 0.03, 0.1),
        **ATARI_NETWORK,
    },
    "icm": {"bonus_weight": (0.0001, 0.0003, 0.001, 0.003, 0.01)},
    "ppo": {
        "learning_rate": (0.0001, 0.0002, 0.0003, 0.0005),
        "entropy_coefficient": (0.001, 0.003, 0.005, 0.01, 0.03),
    },
    "sprl": {
        "learning_rate": (0.0003, 0.0005),
        "cost_scale": (0.01, 0.03, 0.05, 0.1),
        **ATARI_NETWORK,
        "tolerance_samples": (30, 50, 100, 200, 400),
    },
}

WEIGHTS = (0.0001, 0.0002, 0.0003, 0.0005, 0.001, 0.003, 0.01)
FETCH_NETWORK: Ranges = {"bias": (0.5, 1.0), "negative_bias": (1, 2, 3, 5, 8, 12)}
FETCH: Mapping[str, Ranges] = {  # Table 5; SPRL's final cost scale, 0.05, is not in its range
    "eco": {"bonus_weight": WEIGHTS, **FETCH_NETWORK},
    "icm": {"bonus_weight": WEIGHTS},
    "ppo": {"entropy_coefficient": (0.001, 0.003, 0.01)},
    "sprl": {"cost_scale": WEIGHTS, **FETCH_NETWORK},
}

RANGES: Mapping[str, Mapping[str, Ranges]] = {"atari": ATARI, "dmlab": DMLAB, "fetch": FETCH, "grid": GRID}
