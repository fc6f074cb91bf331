"""What recording costs of a training run on FourRooms 7x7, and what keeping every action costs besides.

PPO learns quickest, so the share is largest there. The three loops take turns in one process and do the same work,
update by update, so that a few per cent can be seen. The times are the processor's, not the clock's: other work on the
machine does not count.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from statistics import median

import gymnasium

import sprl_bench
from benchmarks.learners import our_ppo
from benchmarks.measure import Row
from benchmarks.turns import Turn
from sprl_baselines.agents import ppo

TASK = "SPRL/FourRooms-7x7-v1"
SETTINGS = ppo.hyperparameters("grid", {})
RECORD_BAR, KEEP_BAR = 0.97, 0.98
REPEATS = 40


def rows() -> list[Row]:
    """Measure both rows; takes two minutes."""
    with tempfile.TemporaryDirectory() as folder:
        bare, recorded, kept = rates([plain(), recording(Path(folder), "no"), recording(Path(folder), "yes")], REPEATS)
    return [
        row("PPO, FourRooms 7x7, recorded", recorded, "the same without a recorder", bare, RECORD_BAR),
        row(
            "PPO, FourRooms 7x7, recorded, every action kept", kept, "the same without the actions", recorded, KEEP_BAR
        ),
    ]


def plain() -> Turn:
    """Return turns of our learner on bare environments."""
    return our_ppo(gymnasium.make_vec(TASK, num_envs=SETTINGS["num_envs"], num_threads=1), SETTINGS, 1)


def recording(folder: Path, keep: str) -> Turn:
    """Return turns of our learner with a recorder on them; "yes" also keeps the actions, written after each update."""
    made = gymnasium.make_vec(TASK, num_envs=SETTINGS["num_envs"], num_threads=1)
    about = {"agent": f"ppo-{keep}", "seed": 0, "budget": 10**9}
    envs = sprl_bench.record(made, out=folder, keep_actions=keep == "yes", **about)  # type: ignore[arg-type]
    learn = our_ppo(envs, SETTINGS, 1)

    def turn() -> int:
        steps = learn()
        envs.tape.flush()  # type: ignore[attr-defined] # the recorder's own, as a run writes it
        return steps

    return turn


def rates(turns: Sequence[Turn], repeats: int) -> list[list[float]]:
    """Let all take turns, after one unmeasured round, and return the env steps per second of processor time of each."""
    measured: list[list[float]] = [[] for _ in turns]
    for turn in turns:
        turn()
    for _ in range(repeats):
        for turn, rates_of_it in zip(turns, measured, strict=True):
            before = time.process_time()
            steps = turn()
            rates_of_it.append(steps / (time.process_time() - before))
    return measured


def row(what: str, ours: Sequence[float], against: str, theirs: Sequence[float], bar: float) -> Row:
    """Return the row of two contenders that took turns."""
    ratio = median(our_rate / their_rate for our_rate, their_rate in zip(ours, theirs, strict=True))
    return Row(what, against, bar, median(ours), median(theirs), ratio)
