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

AGENTS: Final = "sprl_bench.agents"  # the group of entry points
OWN: Final = ("sprl_bench", "sprl_baselines")
LAUNCHERS: Final = frozenset(
    """
    attrs certifi charset-normalizer click cloudpickle debugpy execnet filelock hypothesis idna iniconfig ipykernel
    ipython jedi jsonschema jsonschema-specifications markdown-it-py mdurl msgpack packaging parso pip pluggy
    prompt-toolkit protobuf pyarrow pygments pytest pytest-xdist pyyaml ray referencing requests rich rpds-py setuptools
    shellingham sortedcontainers submitit tqdm traitlets typer urllib3 wcwidth
    """.split()  # noqa: SIM905 - the list would take a line a name
)
"""Packages that start, show, store or submit runs, with what they need: none of them can move a score."""
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

    At the end of a run, everything that can move a number has been loaded, so no list of such packages is needed. Those
    that only start, show, store or submit runs are left out: equal runs have equal versions, whoever started them.
    """
    loaded = {name.partition(".")[0] for name in sys.modules}
    packages = {package for module in loaded for package in _packages_by_module().get(module, ())}
    packages.add("sprl-bench")  # an editable install does not list its modules
    found = {package.lower().replace("_", "-"): metadata.version(package) for package in packages}
    return {**surroundings(), **{name: found[name] for name in sorted(found) if name not in LAUNCHERS}}


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
    """Return the hash of the code of an agent, or of the running script, which may change without a version.

    Of an agent given as "package.module:attribute" it is that of the module's file, and of an installed one that of all
    sources of its distribution.

    Args:
        source: As in `RunSpec.source`, with its module loaded; empty for the script.

    Returns:
        16 hexadecimal digits; None for an agent of this package, whose commit is known, and without a file, as in a
        notebook.
    """
    try:
        contents = [path.read_bytes() for path in _sources(source)]
    except OSError:
        return None
    return hashlib.sha256(b"".join(contents)).hexdigest()[:16] if contents else None


def _sources(source: str) -> list[Path]:
    """Return the files that make an agent, or the running script."""
    if source and ":" not in source:
        return _of_package(source)
    file = getattr(sys.modules.get(source.partition(":")[0] or "__main__"), "__file__", None)
    return [Path(file)] if file else []


def _of_package(name: str) -> list[Path]:
    """Return all sources that an installed agent came with, none if that is this package."""
    found = [one for one in metadata.entry_points(group=AGENTS) if one.name == name]
    top = found[0].module.partition(".")[0] if found else ""
    if top in OWN or top not in sys.modules:
        return []
    folders = [Path(folder) for folder in getattr(sys.modules[top], "__path__", ())]
    file = getattr(sys.modules[top], "__file__", None)
    package = [path for folder in folders for path in folder.rglob("*.py")] or ([Path(file)] if file else [])
    return sorted({path.resolve() for path in (*package, *_listed(found[0].dist))})


def _listed(distribution: metadata.Distribution | None) -> list[Path]:
    """Return the sources that a distribution says it installed, its other modules too."""
    files = (distribution.files if distribution else None) or ()
    paths = [Path(str(file.locate())) for file in files if file.suffix == ".py"]
    return [path for path in paths if path.exists()]


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
