"""Known answers: tiny environments and published bands that say whether an agent learns as it should."""

from __future__ import annotations

from sprl_bench.known_answers.check import SUITE, Verdict, check_agent

__all__ = ["SUITE", "Verdict", "check_agent"]
