"""Provenance: with which versions, code and hardware a run was made, as one frozen value.

It is taken once, at the start of a run, and stored in its checkpoint and its record.
"""

from __future__ import annotations

import functools
import hashlib
import os
import platform
import re
import resource
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import dataclass, replace
from importlib import metadata
from pathlib import Path
from typing import Any, Final, Self

import psutil

from sprl_bench.records import Hardware

MANY_COMMITS: Final = 6  # what fits a line of a record, at 47 letters with "-dirty" and a comma


@dataclass(frozen=True)
class Provenance:
    """The code, the versions and the machine of a run.

    Attributes:
        git_commits: Of this package's checkout, one for each build that the run used; none for a wheel.
        agent_code: Hash of the agent's own file, or None; see `agent_code`.
        versions: Of Python, the platform and every loaded package.
        hardware: The machine.
        torch_threads: Of this process; 1 without torch.
        peak_memory_mib: The most memory that any process of the run had resident.
    """

    git_commits: tuple[str, ...]
    agent_code: str | None
    versions: Mapping[str, str]
    hardware: Hardware
    torch_threads: int
    peak_memory_mib: float

    @classmethod
    def take(cls, source: str) -> Self:
        """Return the provenance of this process, at the start of a run.

        Args:
            source: The agent's, as in `RunSpec.source`; its module has been loaded.
        """
        commits = tuple(filter(None, [git_commit()]))
        return cls(commits, agent_code(source), versions(), hardware(), _torch_threads(), peak_memory_mib())

    def completed(self) -> Self:
        """Return the provenance at the end of a run: with packages loaded since, the GPU, threads and memory."""
        peak = max(self.peak_memory_mib, peak_memory_mib())
        threads = _torch_threads()
        return replace(self, versions=versions(), hardware=hardware(), torch_threads=threads, peak_memory_mib=peak)

    def continuing(self, earlier: Mapping[str, Any]) -> Self:
        """Return the provenance of a continued run; `earlier` is the `as_dict` of its last process."""
        commits = tuple(dict.fromkeys((*earlier["git_commits"], *self.git_commits)))
        return replace(self, git_commits=commits, peak_memory_mib=earlier["peak_memory_mib"])

    def as_dict(self) -> dict[str, Any]:
        """Return plain values, as a checkpoint takes them."""
        return {**vars(self), "hardware": self.hardware.model_dump()}

    @property
    def device(self) -> str:
        """The kind of device: "cuda" if torch has used a GPU, else "cpu"."""
        return "cuda" if self.hardware.gpu else "cpu"

    @property
    def git_commit(self) -> str | None:
        """The commits in one short line: of many, the first and the last; None without a checkout."""
        if len(self.git_commits) <= MANY_COMMITS:
            return ", ".join(self.git_commits) or None
        return f"{self.git_commits[0]}, {len(self.git_commits) - 2} others, {self.git_commits[-1]}"


def surroundings() -> dict[str, str]:
    """Return the version of Python, and the platform with its C library."""
    library = "-".join((platform.system(), platform.machine(), *platform.libc_ver())).rstrip("-")
    return {"python": platform.python_version(), "platform": library}


def versions() -> dict[str, str]:
    """Return the versions of Python, of the platform, and of every installed package that this process has loaded.

    At the end of a run, everything that can move a number has been loaded, so no list of such packages is needed.
    """
    loaded = {name.partition(".")[0] for name in sys.modules}
    packages = {package for module in loaded for package in _packages_by_module().get(module, ())}
    packages.add("sprl-bench")  # an editable install does not list its modules
    found = {package.lower().replace("_", "-"): metadata.version(package) for package in packages}
    return {**surroundings(), **dict(sorted(found.items()))}


def installed(package: str) -> str | None:
    """Return the version of a package, loaded or not; None if it is not installed."""
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return None


@functools.cache
def _packages_by_module() -> dict[str, list[str]]:
    return dict(metadata.packages_distributions())


@functools.cache
def git_commit() -> str | None:
    """Return this code's commit, with "-dirty" if files are changed; None without version control, as in a wheel."""
    here = Path(__file__)
    if _git("ls-files", "--error-unmatch", here.name) is None:
        return None
    return _git("describe", "--always", "--dirty", "--abbrev=40", "--exclude=*")


def _git(*arguments: str) -> str | None:
    command = ["git", "-C", str(Path(__file__).parent), *arguments]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=30, check=True)
    except (OSError, subprocess.SubprocessError):
        return None
    return done.stdout.strip()


def agent_code(source: str) -> str | None:
    """Return the hash of the file of an agent given as "package.module:attribute", or of the running script.

    Such a file may have no version. Modules that it imports do not count.

    Args:
        source: "package.module:attribute", whose module has been loaded; empty for the script.

    Returns:
        16 hexadecimal digits; None for an installed agent, and without a file, as in a notebook.
    """
    if source and ":" not in source:
        return None
    module = sys.modules.get(source.partition(":")[0] or "__main__")
    file = getattr(module, "__file__", None)
    try:
        return hashlib.sha256(Path(file).read_bytes()).hexdigest()[:16] if file else None
    except OSError:
        return None


def hardware() -> Hardware:
    """Return a description of this machine."""
    return Hardware(
        cpu=_cpu(), cores=os.cpu_count() or 1, memory_gib=round(psutil.virtual_memory().total / 2**30, 1), gpu=_gpu()
    )


def _cpu() -> str:
    information = Path("/proc/cpuinfo")
    named = (
        re.search(r"^model name\s*:\s*(.+)$", information.read_text(), re.MULTILINE) if information.exists() else None
    )
    return named[1].strip() if named else platform.processor() or platform.machine()


def _torch_threads() -> int:
    torch = sys.modules.get("torch")
    return torch.get_num_threads() if torch else 1


def _gpu() -> str | None:
    """Return the name of the GPU if this process has used one."""
    torch = sys.modules.get("torch")
    if torch is None or not torch.cuda.is_initialized():
        return None
    return str(torch.cuda.get_device_name())


def peak_memory_mib() -> float:
    """Return the most memory that this process has had resident, in MiB."""
    status = Path("/proc/self/status")
    peak = re.search(r"^VmHWM:\s*(\d+) kB$", status.read_text(), re.MULTILINE) if status.exists() else None
    # After fork and exec, getrusage would count the parent's peak as well.
    kibibytes = int(peak[1]) if peak else resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return round(kibibytes / 1024, 1)
