"""What is installed, what works, and what would make a score from here incomparable with published ones."""

from __future__ import annotations

from sprl_bench.doctor.findings import BROKEN, INCOMPARABLE, UNKNOWN, Finding, examine, pinned_versions

__all__ = ["BROKEN", "INCOMPARABLE", "UNKNOWN", "Finding", "examine", "pinned_versions"]
