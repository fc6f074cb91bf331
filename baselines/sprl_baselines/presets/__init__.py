"""Presets: named hyperparameters of the agents for each domain, where they differ from the defaults."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from sprl_baselines.presets import atari, dmlab, fetch, grid
from sprl_bench.suggestions import unknown

__all__ = ["DOMAINS", "preset"]

DOMAINS = {"atari": atari.PRESETS, "dmlab": dmlab.PRESETS, "fetch": fetch.PRESETS, "grid": grid.PRESETS}


def preset(domain: str, name: str, agent: str) -> Mapping[str, Any]:
    """Return the hyperparameters that a preset changes for an agent; none for an agent without any presets.

    Raises:
        ValueError: The domain or the preset is unknown, or the agent only has other presets.
    """
    if domain not in DOMAINS:
        raise ValueError(unknown("domain", domain, DOMAINS))
    presets = DOMAINS[domain]
    if name not in presets:
        raise ValueError(unknown(f"preset of domain {domain!r}:", name, presets))
    if agent not in presets[name] and agent in _agents():
        raise ValueError(
            f"agent is {agent!r}; it must be one with the preset {name!r} of domain {domain!r}: "
            f"{', '.join(presets[name])}."
        )
    return presets[name].get(agent, {})


def _agents() -> set[str]:
    """Return the agents that have a preset in any domain."""
    return {agent for presets in DOMAINS.values() for settings in presets.values() for agent in settings}
