"""Files of the repository that a wheel carries as a copy: the leaderboards and the pinned versions."""

from __future__ import annotations

from pathlib import Path


def find_shipped(name: str) -> Path:
    """Return the path of a file in the checkout or, if it is not there, of its copy in an installed wheel."""
    package = Path(__file__).parent
    checkout = package.parent / name
    return checkout if checkout.exists() else package / f"_{name}"
