"""PPO learns: CartPole to its ceiling, FourRooms beyond chance, and what a bonus asks of it."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
import pytest
import torch
from gymnasium.vector import AutoresetMode, SyncVectorEnv, VectorEnv

import sprl_bench  # noqa: F401 - registers the ids
from sprl_baselines.agents import gt_grid, gt_sprl, ppo
from sprl_baselines.random_policy import random

# Where PPO's own defaults are for grids, these are for small, quick control tasks. The value is not clipped, as
# returns of this size are far beyond any clip range. They were settled while looking at seeds 0 to 2 and 10 to 18 (a
# first choice, discount 0.98, lambda 0.8 and 80,000 steps, reached 445 with seed 0 and 500 with 10 to 12; this one
# reached 500 with all). So the test's seeds are others, 20 to 22: declared, with the settings as they stand, before
# anything was run with them. All three passed.
CARTPOLE: dict[str, Any] = {
    "num_envs": 8,
    "rollout_length": 32,
    "epochs": 10,
    "minibatches": 1,
    "learning_rate": 0.001,
    "anneal_learning_rate": True,
    "anneal_clip_range": True,
    "entropy_coefficient": 0.0,
    "clip_value": False,
    "bootstrap_on_truncation": True,
    "mlp_layers": 2,
    "mlp_units": 64,
}
CARTPOLE_BUDGET = 100_000

# Measured with seeds 0 to 3: mean returns 0.35, 0.26, 0.28 and 0.25 in the last fifth of 100,000 steps; the uniform
# policy's was 0.13 to 0.15 over all of them, seeds 0 to 2. The standard error of such a mean is about 0.02.
MARGIN = 0.05


@pytest.fixture(autouse=True)
def one_thread() -> Any:
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(threads)


def cartpoles(count: int, seed: int) -> VectorEnv[Any, Any, Any]:
    envs = SyncVectorEnv([lambda: gymnasium.make("CartPole-v1")] * count, autoreset_mode=AutoresetMode.SAME_STEP)
    envs.reset(seed=seed)
    return envs


def greedy_returns(agent: Any, episodes: int) -> np.ndarray[Any, Any]:
    """Return the return of one episode in each of as many sub-envs, always taking the most likely action."""
    envs = cartpoles(episodes, seed=12345)
    observations, _ = envs.reset()
    returns, running = np.zeros(episodes), np.ones(episodes, dtype=bool)
    while running.any():
        with torch.inference_mode():
            log_probabilities, _ = agent.learner.network(torch.from_numpy(observations))
        actions = log_probabilities.argmax(dim=1).numpy()
        observations, rewards, terminated, truncated, _ = envs.step(actions)
        returns += rewards * running
        running &= ~(terminated | truncated)
    return returns


@pytest.mark.parametrize("seed", [20, 21, 22])
def test_cartpole_is_solved(seed: int) -> None:
    """Mean return of 100 greedy episodes after 100,000 steps, of 500 at most."""
    agent = ppo(seed=seed, **CARTPOLE)
    for _ in agent.train(cartpoles(CARTPOLE["num_envs"], seed), CARTPOLE_BUDGET):
        pass
    assert greedy_returns(agent, episodes=100).mean() >= 475


def episode_returns(agent: Any, budget: int, seed: int) -> tuple[np.ndarray[Any, Any], np.ndarray[Any, Any]]:
    """Train for the first `budget` of 500,000 env steps on FourRooms; return when episodes ended, and their returns."""
    envs = gymnasium.make_vec("SPRL/FourRooms-7x7-v1", num_envs=12, num_threads=1)
    envs.reset(seed=seed)
    step, open_returns, ends, steps = envs.step, np.zeros(12), [], 0

    def counted(actions: Any) -> Any:
        nonlocal steps
        result = step(actions)
        steps += 12
        open_returns[:] += result[1]
        for index in np.flatnonzero(result[2] | result[3]):
            ends.append((steps, open_returns[index]))
            open_returns[index] = 0.0
        return result

    envs.step = counted  # type: ignore[method-assign]
    for _ in agent.train(envs, 500_000):
        if steps >= budget:
            break
    stamps, returns = np.array(ends).T
    return stamps, returns


def test_four_rooms_is_learned_beyond_chance() -> None:
    """Mean return of the training episodes in the last fifth of 100,000 steps, against the uniform policy's."""
    _, uniform = episode_returns(random(seed=0), budget=100_000, seed=0)
    stamps, returns = episode_returns(ppo(seed=0, **ppo.hyperparameters("grid", {})), budget=100_000, seed=0)
    assert returns[stamps > 80_000].mean() > uniform.mean() + MARGIN


# A bonus alone, as no reward is met on KeyDoors by then: the first and the last 6 of 31 updates, 47,000 steps.
# Measured with seeds 0 to 2. First visits per step: 1.46, 1.40 and 1.52 times as many in the end. Share of steps
# charged: less by 0.13, 0.12 and 0.15; with the same cost that weighs nothing: more by 0.08, 0.05 and 0.02. (Where a
# network judges, what it says changes with it, so neither SPRL nor ECO can be read off that way.) The tests' seed,
# 20, was declared before anything was run with it.
ALONE: dict[str, Any] = {"learning_rate": 0.003, "entropy_coefficient": 0.001}
UPDATES, ENDS = 31, 6


def measured(agent: Any, name: str, seed: int) -> tuple[float, float]:
    """Train on KeyDoors and return a metric's mean over the first and over the last updates."""
    envs = gymnasium.make_vec("SPRL/KeyDoors-7x7-v1", num_envs=12, num_threads=1)
    envs.reset(seed=seed)
    values = [report[name] for report, _ in zip(agent.train(envs, 500_000), range(UPDATES), strict=False)]
    return float(np.mean(values[:ENDS])), float(np.mean(values[-ENDS:]))


def test_gt_grid_comes_to_see_more_cells() -> None:
    agent = gt_grid(seed=20, **gt_grid.hyperparameters("grid", {**ALONE, "bonus_weight": 0.1}))
    first, last = measured(agent, "bonus", seed=20)
    assert last > 1.2 * first


def test_gt_sprl_comes_to_be_charged_less() -> None:
    agent = gt_sprl(seed=20, **gt_sprl.hyperparameters("grid", {**ALONE, "cost_scale": 0.1}))
    first, last = measured(agent, "violations", seed=20)
    assert last < first - 0.05
