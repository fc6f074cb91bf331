"""What the agents compute, as digests: run it before and after a change that may move no number, and compare.

    python tests/behaviour.py FOLDER > digests.txt

It trains every reference agent on `smoke` with two seeds, PPO on FetchReach at substep 3 for 20,000 steps, and one run
that is interrupted and resumed. It prints a digest of each run's metrics (without its times), episodes and scores, and
the fingerprint of every environment. The digests of `resumed` must be those of `sprl` in `trusted`. Takes ten minutes.
"""

from __future__ import annotations

import hashlib
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

AGENTS = "ppo,icm,eco,gt-grid,sprl,gt-sprl,random"
# So that short runs train and use their networks.
TRUSTED = [f"--set={name}" for name in ("ready_trainings=1", "ready_accuracy=0.0", "replay_size=6000")]
CLOCKS = ("wall_time_s", "steps_per_second")
COMMAND = (sys.executable, "-m", "sprl_bench", "run", "--device", "cpu", "--seeds", "2")


def _run(root: Path, *arguments: str) -> None:
    subprocess.run([*COMMAND, "--out", str(root), *arguments], check=True, stdout=subprocess.DEVNULL)


def _interrupted(root: Path, *arguments: str) -> None:
    """Stop a run after its first updates, then resume it."""
    begun = subprocess.Popen([*COMMAND, "--out", str(root), *arguments], stdout=subprocess.DEVNULL)
    while not any(path.stat().st_size for path in root.rglob("metrics.jsonl")):
        time.sleep(0.2)
    os.kill(begun.pid, signal.SIGINT)
    begun.wait()
    assert any(root.rglob("checkpoint.safetensors")), "the run was not interrupted between two updates"
    _run(root, *arguments)


def _digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()[:16]


def _metrics(path: Path) -> bytes:
    lines = [json.loads(line) for line in path.read_text().splitlines()]
    kept = [{name: value for name, value in line.items() if name not in CLOCKS} for line in lines]
    return json.dumps(kept, sort_keys=True).encode()


def _print_digests(root: Path) -> None:
    for path in sorted(root.rglob("record.json")):
        record = json.loads(path.read_text())
        scores = json.dumps([record["scores"], record["return_curve"], record["success_curve"], record["totals"]])
        print(
            path.parent.relative_to(root.parent),
            f"metrics {_digest(_metrics(path.with_name('metrics.jsonl')))}",
            f"episodes {_digest(path.with_name('episodes.parquet').read_bytes())}",
            f"scores {_digest(scores.encode())}",
            f"fingerprint {record['fingerprint']}",
        )


def _print_fingerprints() -> None:
    from sprl_bench.recorder.fingerprint import fingerprint
    from sprl_bench.records import TaskSpec
    from sprl_bench.tasks import SUITES

    for suite in SUITES.values():
        for task in suite.tasks:
            print(f"{suite.name}/{task.name} {fingerprint(TaskSpec.of(task))}")


def main(root: Path) -> None:
    """Train, and print the digests."""
    smoke = ("--suite", "smoke")
    _run(root / "smoke", *smoke, "--agents", AGENTS)
    _run(root / "trusted", *smoke, "--agents", "eco,sprl", *TRUSTED)
    reach = ("--suite", "sparsity", "--task", "FetchReach-substep3", "--agents", "ppo", "--budget", "20000")
    _run(root / "fetch", *reach)
    _interrupted(root / "resumed", *smoke, "--agents", "sprl", *TRUSTED)
    for part in ("smoke", "trusted", "fetch", "resumed"):
        _print_digests(root / part)
    _print_fingerprints()


if __name__ == "__main__":
    main(Path(sys.argv[1]))
