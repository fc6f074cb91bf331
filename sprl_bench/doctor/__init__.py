"""Checks of the installation: what is installed, what works, and whether scores are comparable."""

from __future__ import annotations

from sprl_bench.doctor.findings import BROKEN, INCOMPARABLE, UNKNOWN, Finding, examine, pinned_versions

__all__ = ["BROKEN", "INCOMPARABLE", "UNKNOWN", "Finding", "examine", "pinned_versions"]
