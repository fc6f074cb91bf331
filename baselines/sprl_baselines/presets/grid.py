"""Settings for the grid worlds (appendix D.3)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

# Table 1's final values are the defaults.
TABLE: Mapping[str, Mapping[str, Any]] = {"gt-grid": {}, "icm": {}, "ppo": {}}

PRESETS = {"table": TABLE}
