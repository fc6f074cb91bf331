"""Settings for the Fetch tasks (appendix G)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

# Table 5's final values, and G.3's normalisation of rewards. The table has no GT-Grid, as there are no cells.
COMMON: Mapping[str, Any] = {"learning_rate": 0.0005, "action_noise": 0.003, "reward_normalization": "extrinsic"}
TABLE: Mapping[str, Mapping[str, Any]] = {
    "icm": {
        **COMMON,
        "entropy_coefficient": 0.001,
        "bonus_weight": 0.001,
        "forward_share": 1.0,
        "icm_loss_weight": 1.0,
        "icm_learning_rate": 0.0005,
    },
    "ppo": {**COMMON, "entropy_coefficient": 0.01},
}

PRESETS = {"table": TABLE}
