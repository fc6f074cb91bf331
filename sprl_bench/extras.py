"""The optional extras: their purpose, their modules, and how to install them."""

from __future__ import annotations

import importlib
import shlex
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from types import MappingProxyType
from typing import Any

from sprl_bench.shipped import find_shipped


@dataclass(frozen=True)
class Extra:
    """One optional extra of the package.

    Attributes:
        modules: Those it installs; the first one shows whether it is installed.
        purpose: The part of the package that needs it.
    """

    modules: tuple[str, ...]
    purpose: str

    @property
    def installed(self) -> bool:
        """Whether it is installed."""
        return find_spec(self.modules[0]) is not None


EXTRAS: Mapping[str, Extra] = MappingProxyType(
    {
        "atari": Extra(("ale_py",), "the Atari games"),
        "baselines": Extra(("torch",), "the reference agents, except the random one"),
        "fetch": Extra(("gymnasium_robotics", "mujoco"), "the Fetch environments"),
        "plots": Extra(("matplotlib", "pandas"), "sprl-bench plot, and results as data frames"),
        "ray": Extra(("ray",), "--executor ray"),
        "sb3": Extra(("stable_baselines3",), "the engines as Stable-Baselines3's vector environments"),
        "slurm": Extra(("submitit",), "--executor slurm"),
        "tensorboard": Extra(("tensorboard",), "--log tensorboard"),
        "video": Extra(("imageio_ffmpeg", "imageio"), "sprl-bench video"),
    }
)


def extra_of(module: str) -> str | None:
    """Return the name of the extra that installs a module, or None if no extra does."""
    package = module.partition(".")[0]
    return next((name for name, extra in EXTRAS.items() if package in extra.modules), None)


def advice(extra: str) -> str:
    """Return the command that installs an extra, or several with commas between, in the pinned versions."""
    pinned = find_shipped("constraints.txt")
    here = Path.cwd()
    path = pinned.relative_to(here) if pinned.is_relative_to(here) else pinned
    return f"pip install -c {shlex.quote(str(path))} 'sprl-bench[{extra}]'"


def not_installed(module: str) -> str:
    """Return the sentence that says how to install a module of an extra."""
    return f"{module} is not installed; install it with: {advice(extra_of(module) or module)}"


def require_extra(module: str) -> Any:
    """Import a module of an extra.

    Raises:
        ModuleNotFoundError: It is not installed; the message says how to install it.
    """
    try:
        return importlib.import_module(module)
    except ModuleNotFoundError:
        raise ModuleNotFoundError(not_installed(module), name=module) from None
