"""What each bonus costs: the steps a second of every reference agent over those of plain PPO, on the same task.

Every bonus is computed in full but weighs nothing, so all agents live through the very steps that PPO does: what
differs is the bonus's own work. A turn is four rollouts and updates, and so one training of a reachability network.
Before the first one that is timed, each agent has filled its replay, and its network is trusted from its first training
on, for this alone: it then does all the work that it will ever do.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import gymnasium

import sprl_bench  # noqa: F401 - registers the ids
from benchmarks.contenders import contender
from benchmarks.learners import set_up_torch, threads, turn_steps
from benchmarks.measure import Row, compare
from benchmarks.turns import Turn
from sprl_baselines.ppo import PPOConfig
from sprl_bench.agents import load_factory

TASK = "SPRL/FourRooms-7x7-v1"
TIMES = {  # of PPO's time, at most
    "count": 1.05,
    "gt-grid": 1.05,
    "rnd": 1.5,
    "icm": 1.6,
    "gt-sprl": 2.0,
    "sprl": 2.0,
    "eco": 2.5,
}
TRUSTED = {"ready_trainings": 1, "ready_accuracy": 0.0}
SAME_STEPS: Mapping[str, Mapping[str, Any]] = {
    "ppo": {},
    "count": {"bonus_weight": 0.0},
    "gt-grid": {"bonus_weight": 0.0},
    "rnd": {"bonus_weight": 0.0},
    "icm": {"bonus_weight": 0.0},
    "gt-sprl": {"cost_scale": 0.0, "learning_rate": PPOConfig.learning_rate},
    "sprl": {"cost_scale": 0.0, "learning_rate": PPOConfig.learning_rate, **TRUSTED},
    "eco": {"bonus_weight": 0.0, **TRUSTED},
}
WARM_UP, TURN, REPEATS, NUM_THREADS = 40, 4, 7, 1  # updates, updates, turns


def rows() -> list[Row]:
    """Measure all rows; takes about ten minutes."""
    return [_against_ppo(agent, times) for agent, times in TIMES.items()]


def _against_ppo(agent: str, times: float) -> Row:
    what = f"{agent}, FourRooms 7x7, {threads(NUM_THREADS)}"
    theirs = contender(training, agent="ppo")
    return compare(what, contender(training, agent=agent), "ppo", theirs, bar=round(1 / times, 3), repeats=REPEATS)


def training(agent: str) -> Turn:
    """Return turns of an agent whose bonus weighs nothing."""
    set_up_torch(NUM_THREADS)
    factory = load_factory(agent)
    settings = factory.hyperparameters("grid", SAME_STEPS[agent])  # type: ignore[attr-defined] # all of ours have presets
    envs = gymnasium.make_vec(TASK, num_envs=settings["num_envs"], num_threads=1)
    envs.reset(seed=0)
    updates = factory(seed=0, **settings).train(envs, budget=10**9)
    for _ in range(WARM_UP):
        next(updates)

    def turn() -> int:
        for _ in range(TURN):
            next(updates)
        return TURN * turn_steps(settings)

    return turn
