"""Presets for the grid worlds (appendix D.3)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

# Table 1's final values are the defaults, except SPRL's learning rate.
SPRL: Mapping[str, Any] = {"learning_rate": 0.01}
TABLE: Mapping[str, Mapping[str, Any]] = {
    "count": {},
    "eco": {},
    "gt-grid": {},
    "gt-sprl": SPRL,
    "icm": {},
    "ppo": {},
    "rnd": {},
    "sprl": SPRL,
}

# The best values of appendices A.1 and A.2, which differ from Table 1: one path length, k + 25.
LONGER: Mapping[str, Any] = {**SPRL, "k": 5, "tolerance": 25, "tolerance_samples": 1}
ABLATION: Mapping[str, Mapping[str, Any]] = {"gt-sprl": LONGER, "sprl": LONGER}

# The winners of a sweep of four settings for each agent (`notes/agents-sweep.md`).
TUNED: Mapping[str, Mapping[str, Any]] = {
    "eco": {"bonus_weight": 0.005},
    "gt-grid": {"bonus_weight": 0.03},
    "gt-sprl": {**SPRL, "cost_scale": 0.01},
    "icm": {},
    "ppo": {},
    "sprl": {"cost_scale": 0.01},
}

PRESETS = {"ablation": ABLATION, "table": TABLE, "tuned": TUNED}
