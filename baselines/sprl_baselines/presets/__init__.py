"""Named settings of the agents, domain by domain: only what differs from the defaults."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from sprl_baselines.presets import fetch, grid
from sprl_bench.suggestions import unknown

DOMAINS = {"fetch": fetch.PRESETS, "grid": grid.PRESETS}


def preset(domain: str, name: str, agent: str) -> Mapping[str, Any]:
    """Return what the named preset changes for an agent in a domain.

    Raises:
        ValueError: The domain or the preset is unknown.
    """
    if domain not in DOMAINS:
        raise ValueError(unknown("domain", domain, DOMAINS))
    presets = DOMAINS[domain]
    if name not in presets:
        raise ValueError(unknown(f"{domain} preset", name, presets))
    return presets[name].get(agent, {})
