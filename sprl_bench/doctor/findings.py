"""What is installed, what works, and whether scores from here are comparable with published ones."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib.metadata import version
from types import MappingProxyType
from typing import Any

from sprl_bench.extras import EXTRAS, Extra, advice
from sprl_bench.provenance import installed, surroundings
from sprl_bench.shipped import find_shipped

BROKEN, INCOMPARABLE, UNKNOWN, SOUND = "x", "!", "?", " "
NO_PICTURES = (
    "training needs no pictures. To draw without a display and a GPU, install Mesa (Debian: apt install libegl1 "
    "libegl-mesa0 libgl1-mesa-dri) and set MUJOCO_GL=egl"
)


@dataclass(frozen=True)
class Finding:
    """One line of the doctor's output.

    Attributes:
        subject: A package, an extra, or a probe.
        text: The result.
        comparable: Whether scores are comparable with those of the pinned versions; None if unknown.
        works: False if it is installed and does not work.
    """

    subject: str
    text: str
    comparable: bool | None = True
    works: bool = True

    @property
    def mark(self) -> str:
        """The first character of the line."""
        if not self.works:
            return BROKEN
        return {True: SOUND, False: INCOMPARABLE, None: UNKNOWN}[self.comparable]


def examine() -> list[Finding]:
    """Check this installation; it takes a few seconds."""
    from sprl_bench.doctor.probes import probe
    from sprl_bench.tables import SCORED_PACKAGES

    pins = pinned_versions()
    answers = probe()
    return [
        *(Finding(name, found) for name, found in surroundings().items()),
        Finding("sprl-bench", version("sprl-bench")),
        *(_package(name, pins) for name in SCORED_PACKAGES if name != "sprl-bench"),
        *(_extra(name, extra) for name, extra in EXTRAS.items()),
        _cores(),
        _mazes(),
        *(_tried(subject, answers[name], tell) for name, (subject, tell) in TRIED.items() if name in answers),
    ]


def _package(name: str, pins: Mapping[str, str]) -> Finding:
    there = installed(name)
    if there is None:
        return Finding(name, "not installed")
    pinned = pins.get(name)
    if pinned is None:
        return Finding(name, f"{there}, not pinned", comparable=None)
    # A build such as 2.13.0+cpu is of the pinned release.
    same = there.partition("+")[0] == pinned
    text = f"{there}, as in scored runs" if same else f"{there}, but scored runs use {pinned}"
    return Finding(name, text, comparable=same)


def _extra(name: str, extra: Extra) -> Finding:
    if not extra.installed:
        return Finding(f"[{name}]", f"not installed: {extra.purpose}; install it with: {advice(name)}")
    return Finding(f"[{name}]", f"installed: {extra.purpose}")


def _cores() -> Finding:
    from sprl_bench.envs.threads import usable_cores
    from sprl_bench.records import RunSpec

    threads = RunSpec.model_fields["torch_threads"].default
    return Finding("cores", f"{usable_cores()} of {os.cpu_count()} may be used; torch uses {threads} in each run")


def _mazes() -> Finding:
    from sprl_bench.envs.maze.maze_bank import is_intact

    if is_intact():
        return Finding("mazes", "10,000 layouts of each level, as in scored runs")
    return Finding("mazes", "other layouts than in scored runs", comparable=False)


def _tried(subject: str, answer: Mapping[str, Any], tell: Callable[[Mapping[str, Any]], Finding]) -> Finding:
    from sprl_bench.doctor.probes import TROUBLE

    if TROUBLE not in answer:
        return tell(answer)
    chosen = f" with MUJOCO_GL={backend}" if (backend := os.environ.get("MUJOCO_GL")) else ""
    advice = f"; {NO_PICTURES}" if tell is _drawing else ""
    return Finding(subject, f"does not work{chosen} ({' '.join(answer[TROUBLE].split())}){advice}", works=False)


def _computing(answer: Mapping[str, Any]) -> Finding:
    return Finding("device", f"--device auto means {answer['device']}")


def _joints(answer: Mapping[str, Any]) -> Finding:
    if not answer["broken"]:
        return Finding("joints", "gymnasium-robotics reads them under this mujoco; our fix is not in force")
    if not answer["mended"]:
        return Finding("joints", "gymnasium-robotics cannot read them under this mujoco, even mended", works=False)
    return Finding("joints", "gymnasium-robotics cannot read them under this mujoco; our fix is in force")


def _drawing(answer: Mapping[str, Any]) -> Finding:
    height, width = answer["shape"]
    took = f"{width}x{height} in {1000 * answer['seconds']:.0f} ms"
    return Finding("rendering", f"works: {took} through {answer['backend']} on {answer['driver']}")


TRIED: Mapping[str, tuple[str, Callable[[Mapping[str, Any]], Finding]]] = MappingProxyType(
    {"computing": ("device", _computing), "joints": ("joints", _joints), "drawing": ("rendering", _drawing)}
)
"""By probe: the subject, and the finding for its answer."""


def pinned_versions() -> dict[str, str]:
    """Return the versions that scored runs use, by package: those of constraints.txt, in a checkout or a wheel."""
    file = find_shipped("constraints.txt")
    pins = re.findall(r"^([A-Za-z0-9._-]+)==([^\s;#]+)", file.read_text() if file.exists() else "", re.MULTILINE)
    return {name.lower().replace("_", "-"): pinned for name, pinned in pins}
