"""What a run ran on: versions, code, hardware, memory."""

from __future__ import annotations

import functools
import hashlib
import os
import platform
import re
import resource
import subprocess
import sys
from importlib import metadata
from pathlib import Path

import psutil

from sprl_bench.records import Hardware


def versions() -> dict[str, str]:
    """Return the versions of Python, of the C library, and of every installed package that this process has loaded.

    Whatever can move a number has been loaded when the run is over, so no list of such packages is needed.
    """
    loaded = {name.partition(".")[0] for name in sys.modules}
    packages = {package for module in loaded for package in _packages_by_module().get(module, ())}
    packages.add("sprl-bench")  # an editable install does not list its modules
    found = {package.lower().replace("_", "-"): metadata.version(package) for package in packages}
    library = "-".join((platform.system(), platform.machine(), *platform.libc_ver())).rstrip("-")
    return {"python": platform.python_version(), "platform": library, **dict(sorted(found.items()))}


def installed(package: str) -> str | None:
    """Return the version of a package that need not be loaded; None if it is not installed."""
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return None


@functools.cache
def _packages_by_module() -> dict[str, list[str]]:
    return dict(metadata.packages_distributions())


@functools.cache
def git_commit() -> str | None:
    """Return the commit of the checkout that this code is from, "-dirty" behind it where files differ.

    Returns:
        None where the code is not under version control, as in an installed wheel.
    """
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
    """Return the hash of the file of an agent that is named by it, or of the script: 16 hexadecimal digits.

    No version need stand for such a file. What it imports does not count.

    Args:
        source: "package.module:attribute", whose module has been loaded; empty for the script that is running.

    Returns:
        None for an agent that has a name of its own, and where there is no file, as in a notebook.
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
    """Return what the process runs on."""
    return Hardware(
        cpu=_cpu(),
        cores=os.cpu_count() or 1,
        memory_gib=round(psutil.virtual_memory().total / 2**30, 1),
        gpu=_gpu(),
    )


def _cpu() -> str:
    information = Path("/proc/cpuinfo")
    named = (
        re.search(r"^model name\s*:\s*(.+)$", information.read_text(), re.MULTILINE) if information.exists() else None
    )
    return named[1].strip() if named else platform.processor() or platform.machine()


def computing() -> dict[str, str | int]:
    """Return the device and the torch threads that this process computes with, as far as torch tells."""
    torch = sys.modules.get("torch")
    if torch is None:
        return {"device": "cpu", "torch_threads": 1}
    return {"device": "cuda" if torch.cuda.is_initialized() else "cpu", "torch_threads": torch.get_num_threads()}


def _gpu() -> str | None:
    """Return the name of the GPU if this process has used one."""
    torch = sys.modules.get("torch")
    if torch is None or not torch.cuda.is_initialized():
        return None
    return str(torch.cuda.get_device_name())


def peak_memory_mib() -> float:
    """Return the most memory that this process has had resident since it started, in MiB."""
    status = Path("/proc/self/status")
    peak = re.search(r"^VmHWM:\s*(\d+) kB$", status.read_text(), re.MULTILINE) if status.exists() else None
    # getrusage would count the parent's peak as well in a process that was started by fork and exec.
    kibibytes = int(peak[1]) if peak else resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return round(kibibytes / 1024, 1)
