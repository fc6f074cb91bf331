"""Probes of what works, run in a process of their own: a graphics driver may crash it.

`python -m sprl_bench.doctor.probes` prints one line of JSON for each probe, as soon as its answer is known.
"""

from __future__ import annotations

import importlib.util
import json
import subprocess
import sys
import time
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any, Final

PATIENCE_S: Final = 120.0  # for all probes; the first picture of a busy machine takes a while
TROUBLE: Final = "trouble"
"""The key of an error in an answer."""

Answer = dict[str, Any]


def _computing() -> Answer:
    """Return the device of `--device auto`."""
    import torch

    return {"device": torch.cuda.get_device_name() if torch.cuda.is_available() else "cpu"}


def _joints() -> Answer:
    """Return whether Gymnasium-Robotics is broken with this MuJoCo, and whether our fixed copy works."""
    from sprl_bench.envs.fetch.upstream import is_broken, joint_utils

    return {"broken": is_broken(), "mended": not is_broken(joint_utils())}


def _drawing() -> Answer:
    """Draw one picture, and return the backend, the driver and the time."""
    import gymnasium
    import numpy as np

    from sprl_bench.envs.fetch.picture import drivers

    env = gymnasium.make("SPRL/FetchReachSparse-v1", render_mode="rgb_array")
    env.reset(seed=0)
    env.render()
    started = time.perf_counter()
    picture = np.asarray(env.render())
    seconds = time.perf_counter() - started
    if len(np.unique(picture)) == 1:
        raise RuntimeError("the picture is empty")
    answer = {"backend": _backend(), "driver": drivers().pop(), "shape": picture.shape[:2], "seconds": seconds}
    env.close()
    return answer


def _backend() -> str:
    """Return the OpenGL backend: MuJoCo tries them in this order, so it is the last one loaded."""
    return [name for name in ("glfw", "egl", "osmesa") if f"mujoco.{name}" in sys.modules][-1]


PROBES: Mapping[str, tuple[tuple[str, ...], Callable[[], Answer]]] = MappingProxyType(
    {
        "computing": (("torch",), _computing),
        "joints": (("mujoco", "gymnasium_robotics"), _joints),
        "drawing": (("mujoco", "gymnasium_robotics"), _drawing),
    }
)
"""Each probe with the modules that it needs."""


def main() -> None:
    """Print the answer of each probe whose modules are installed."""
    for name in _possible():
        print(json.dumps({"probe": name, **_ask(PROBES[name][1])}), flush=True)


def _possible() -> list[str]:
    return [name for name, (needs, _) in PROBES.items() if all(importlib.util.find_spec(module) for module in needs)]


def _ask(ask: Callable[[], Answer]) -> Answer:
    try:
        return ask()
    except Exception as error:  # a library or a driver may raise anything
        return {TROUBLE: f"{type(error).__name__}: {error}"}


def probe() -> dict[str, Answer]:
    """Return the answers by probe, from a process of its own; a probe that crashed it has only the trouble."""
    command = [sys.executable, "-P", "-m", "sprl_bench.doctor.probes"]
    try:
        done = subprocess.run(command, capture_output=True, timeout=PATIENCE_S, check=False)
        printed, trouble = done.stdout, f"the process that tried it ended with status {done.returncode}"
    except subprocess.TimeoutExpired as error:
        printed, trouble = error.stdout or b"", f"no answer within {PATIENCE_S:g} s"
    unanswered: dict[str, Answer] = {name: {TROUBLE: trouble} for name in _possible()}
    return {**unanswered, **_parse(printed.decode(errors="replace"))}


def _parse(printed: str) -> dict[str, Answer]:
    """Return the answers in the output; a library may have printed too."""
    answers = [json.loads(line) for line in printed.splitlines() if line.startswith('{"probe": ')]
    return {answer.pop("probe"): answer for answer in answers}


if __name__ == "__main__":
    main()
