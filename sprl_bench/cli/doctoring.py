"""What is installed, and what would make a score from here incomparable with published ones."""

# ruff: noqa: PLC0415 - a command loads what it needs when it is called, so that help is quick

from __future__ import annotations

import platform
import re
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec
from pathlib import Path
from types import MappingProxyType

import typer

__all__ = ["Finding", "doctor", "examine", "pinned_versions"]

EXTRAS: Mapping[str, tuple[str, str]] = MappingProxyType(
    {
        "baselines": ("torch", "our agents, except the random one"),
        "fetch": ("gymnasium_robotics", "the Fetch environments"),
        "plots": ("matplotlib", "sprl-bench plot"),
        "ray": ("ray", "--executor ray"),
        "slurm": ("submitit", "--executor slurm"),
    }
)
MARKS: Mapping[bool | None, str] = MappingProxyType({True: " ", False: "!", None: "?"})


@dataclass(frozen=True)
class Finding:
    """One line of the doctor's.

    Attributes:
        subject: A package or an extra.
        text: What was found.
        comparable: False where scores from here would not compare with those of the pinned versions; None where
            that cannot be told.
    """

    subject: str
    text: str
    comparable: bool | None = True


def doctor() -> None:
    """Tell what is installed, and what would make a score incomparable."""
    findings = examine()
    width = max(len(finding.subject) for finding in findings)
    for finding in findings:
        typer.echo(f"{MARKS[finding.comparable]} {finding.subject.ljust(width)}  {finding.text}")
    wrong = [finding.subject for finding in findings if finding.comparable is False]
    open_questions = [finding.subject for finding in findings if finding.comparable is None]
    if wrong:
        typer.echo(f"Scores from here may not compare with published ones: {', '.join(wrong)}.")
        typer.echo("Install the pinned versions with: pip install -c constraints.txt 'sprl-bench[baselines]'")
    if open_questions:
        typer.echo(f"Cannot tell for want of a pinned version (constraints.txt): {', '.join(open_questions)}.")
    if not wrong and not open_questions:
        typer.echo("Scores from here compare with published ones.")


def examine() -> list[Finding]:
    """Return what there is to say about this installation."""
    from sprl_bench.tables import SCORED_PACKAGES

    pins = pinned_versions()
    return [
        Finding("python", platform.python_version()),
        Finding("sprl-bench", version("sprl-bench")),
        *(_package(name, pins) for name in SCORED_PACKAGES if name != "sprl-bench"),
        *(_extra(name, *needs) for name, needs in EXTRAS.items()),
    ]


def _package(name: str, pins: Mapping[str, str]) -> Finding:
    try:
        installed = version(name)
    except PackageNotFoundError:
        return Finding(name, "not installed")
    pinned = pins.get(name)
    if pinned is None:
        return Finding(name, f"{installed}, not pinned", comparable=None)
    # A build such as 2.13.0+cpu is of the pinned release.
    same = installed.partition("+")[0] == pinned
    return Finding(name, installed if same else f"{installed}, scored runs use {pinned}", comparable=same)


def _extra(name: str, module: str, purpose: str) -> Finding:
    if find_spec(module) is None:
        return Finding(f"[{name}]", f"not installed: {purpose}; get it with: pip install 'sprl-bench[{name}]'")
    return Finding(f"[{name}]", f"installed: {purpose}")


def pinned_versions() -> dict[str, str]:
    """Return the versions that scored runs use, by package: those of constraints.txt, in a checkout or a wheel."""
    package = Path(__file__).parents[1]
    places = (package.parent / "constraints.txt", package / "_constraints.txt")
    text = next((place.read_text() for place in places if place.exists()), "")
    pins = re.findall(r"^([A-Za-z0-9._-]+)==([^\s;#]+)", text, re.MULTILINE)
    return {name.lower().replace("_", "-"): pinned for name, pinned in pins}
