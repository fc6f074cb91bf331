"""Presets for Atari (appendix F)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from sprl_baselines.presets.dmlab import FRAME

COMMON: Mapping[str, Any] = {
    **FRAME,
    "learning_rate": 0.0005,
    "reward_clip": 1.0,  # Table 3
}  # Table 4; FRAME is not in the paper
NETWORK: Mapping[str, Any] = {
    "k": 12,
    "negative_bias": 80,
    "replay_size": 30_000,
    "max_pairs": 30_000,  # from the settings that the authors published
    "embedding_units": 512,  # appendix E.4, cited by F.4
    "head_layers": 3,
    "head_units": 512,
    "later_from": 1_000_000,  # appendix F.3, like the settings below
    "train_every_later": 150_000,
    "weight_decay": 0.03,
    "label_smoothing": 0.1,
    "pair_input": "difference",
    "accuracy_pairs": 7_500,  # appendix B.1
}
TABLE: Mapping[str, Mapping[str, Any]] = {
    "eco": {**COMMON, **NETWORK, "bonus_weight": 0.001},
    "icm": {**COMMON, "bonus_weight": 0.01, "forward_share": 1.0, "icm_loss_weight": 1.0, "icm_learning_rate": 0.0005},
    "ppo": COMMON,
    "rnd": COMMON,  # not in the paper
    "sprl": {**COMMON, **NETWORK, "cost_scale": 0.05, "tolerance_samples": 200},
}

PRESETS = {"table": TABLE}
