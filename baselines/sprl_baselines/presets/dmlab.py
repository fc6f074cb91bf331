"""Presets for DeepMind Lab's levels and the mazes that stand for them.

SPRL's hyperparameters are those of Table 2. Appendix E.4 takes the other agents' from Savinov et al. (2019); they and
the other settings of PPO are from the settings that the authors published.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

FRAME: Mapping[str, Any] = {"clip_range": 0.1, "rollout_length": 256}
SAVINOV: Mapping[str, Any] = {**FRAME, "learning_rate": 0.00025}
NETWORK: Mapping[str, Any] = {
    "max_pairs": 30_000,  # from the settings that the authors published
    "embedding_units": 512,  # appendix E.4: 512 units for each state, then three layers of 512
    "head_layers": 3,
    "head_units": 512,
    "later_from": 1_000_000,  # appendix E.3: every 6K steps for 1M steps, every 12K for another 1M, then every 36K
    "last_from": 2_000_000,
}
TABLE: Mapping[str, Mapping[str, Any]] = {
    "eco": {**SAVINOV, **NETWORK, "entropy_coefficient": 0.0021, "k": 5, "bonus_weight": 0.03},
    "gt-grid": {**SAVINOV, "entropy_coefficient": 0.0066, "bonus_weight": 0.05247, "cube_size": 30.0},
    "icm": {
        **SAVINOV,
        "entropy_coefficient": 0.0042,
        "bonus_weight": 0.55,
        "forward_share": 0.96,
        "icm_loss_weight": 64.0,
        "icm_learning_rate": 0.00025,
    },
    "ppo": {**FRAME, "learning_rate": 0.00019, "entropy_coefficient": 0.0011},
    "rnd": {**SAVINOV, "entropy_coefficient": 0.0021},  # not in the paper
    "sprl": {
        **FRAME,
        **NETWORK,
        "max_grad_norm": 10.0,  # from the settings that the authors published, for SPRL only
        "learning_rate": 0.0003,
        "entropy_coefficient": 0.004,
        "k": 10,
        "cost_scale": 0.06,
        "tolerance_samples": 200,
    },
}

PRESETS = {"table": TABLE}
