"""Which reference agents are privileged: an entry of one cannot say otherwise, wherever it is checked.

A table, so that an entry can be checked where the agents are not installed, and without loading one.
"""

from __future__ import annotations

from types import MappingProxyType
from typing import Final

PRIVILEGED: Final = MappingProxyType(
    {
        "count": True,
        "eco": False,
        "gt-grid": True,
        "gt-sprl": True,
        "icm": False,
        "ppo": False,
        "random": False,
        "rnd": False,
        "sprl": False,
    }
)
PACKAGE: Final = "sprl_baselines"


def check_privileged(source: str, privileged: bool) -> None:
    """Check what a run or an entry says of itself against what its agent declares, if it is a reference agent.

    Args:
        source: What made the agent: an installed agent's name or "package.module:attribute".
        privileged: What the run or the entry says.

    Raises:
        ValueError: The agent declares the other.
    """
    module, _, attribute = source.partition(":")
    name = attribute.replace("_", "-") if module.partition(".")[0] == PACKAGE else source
    if PRIVILEGED.get(name, privileged) != privileged:
        said, declared = (str(one).lower() for one in (privileged, not privileged))
        raise ValueError(f"privileged: it is {said} here; the reference agent {name!r} declares {declared}")
