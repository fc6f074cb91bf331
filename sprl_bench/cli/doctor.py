"""The command that checks the installation."""

from __future__ import annotations

import typer

from sprl_bench.doctor import BROKEN, INCOMPARABLE, UNKNOWN, Finding, examine
from sprl_bench.extras import EXTRAS, advice


def doctor() -> None:
    """Check what is installed, what works, and whether scores would be comparable with published ones."""
    findings = examine()
    width = max(len(finding.subject) for finding in findings)
    for finding in findings:
        typer.echo(f"{finding.mark} {finding.subject.ljust(width)}  {finding.text}")
    for line in _conclude(findings):
        typer.echo(line)


def _conclude(findings: list[Finding]) -> list[str]:
    broken, wrong, open_questions = (
        ", ".join(finding.subject for finding in findings if finding.mark == mark)
        for mark in (BROKEN, INCOMPARABLE, UNKNOWN)
    )
    lines = []
    if broken:
        lines.append(f"Does not work here: {broken}.")
    if wrong:
        extras = ",".join(name for name in ("atari", "baselines", "fetch") if EXTRAS[name].installed) or "baselines"
        lines.append(f"Scores from here may not compare with published ones: {wrong}.")
        lines.append(f"Install the pinned versions with: {advice(extras)}")
    if open_questions:
        lines.append(f"No pinned version to compare with (constraints.txt): {open_questions}.")
    if not wrong and not open_questions:
        lines.append("Scores from here compare with published ones.")
    return lines
