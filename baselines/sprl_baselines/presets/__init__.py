"""Named settings of the agents, domain by domain: what differs from the defaults or between a domain's agents."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from sprl_baselines.presets import atari, dmlab, fetch, grid
from sprl_bench.suggestions import unknown

__all__ = ["DOMAINS", "preset"]

DOMAINS = {"atari": atari.PRESETS, "dmlab": dmlab.PRESETS, "fetch": fetch.PRESETS, "grid": grid.PRESETS}


def preset(domain: str, name: str, agent: str) -> Mapping[str, Any]:
    """Return what the named preset changes for an agent in a domain: nothing for an agent that has no preset at all.

    Raises:
        ValueError: The domain or the preset is unknown, or the agent has presets, but not this one.
    """
    if domain not in DOMAINS:
        raise ValueError(unknown("domain", domain, DOMAINS))
    presets = DOMAINS[domain]
    if name not in presets:
        raise ValueError(unknown(f"preset of domain {domain!r}:", name, presets))
    if agent not in presets[name] and agent in _agents():
        raise ValueError(
            f"Agent {agent!r} has no settings for domain {domain!r} (preset {name!r}); "
            f"those that have: {', '.join(presets[name])}."
        )
    return presets[name].get(agent, {})


def _agents() -> set[str]:
    """Return the agents that have a preset in some domain."""
    return {agent for presets in DOMAINS.values() for settings in presets.values() for agent in settings}
