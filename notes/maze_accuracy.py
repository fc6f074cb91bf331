"""Train the reachability network on a uniformly random policy's steps: `python notes/maze_accuracy.py`.

The level is GoalSmall; network, schedule and replay are those of `sprl` with the preset `table`. Prints the accuracy of
appendix B.1 on steps that the network was not trained on, with the seconds until then. notes/maze-accuracy.md has what
it gave.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator
from typing import Any

import gymnasium
import numpy as np
import torch
from torch import Tensor

import sprl_bench  # noqa: F401 - registers the ids
from sprl_baselines.bonus import Setting
from sprl_baselines.learning.rollout import Rollout
from sprl_baselines.presets import preset
from sprl_baselines.reachability.hyperparameters import ReachabilityConfig
from sprl_baselines.reachability.learned import LearnedReachability
from sprl_baselines.reachability.triplets import NEGATIVES

NUM_ENVS, STEPS = 12, 256


def rollouts(envs: Any, seed: int, device: str) -> Iterator[Rollout]:
    """Yield rollouts of a uniformly random policy."""
    generator = np.random.default_rng(seed)
    observations, _ = envs.reset(seed=seed)
    while True:
        seen, rewards, ends = [], [], []
        for _ in range(STEPS):
            seen.append(torch.from_numpy(observations.copy()))
            actions = generator.integers(0, envs.single_action_space.n, NUM_ENVS)
            observations, reward, _, truncated, _ = envs.step(actions)
            rewards.append(torch.from_numpy(reward.astype(np.float32)))
            ends.append(torch.from_numpy(truncated.copy()))
        yield _rollout(*(torch.stack(part).to(device) for part in (seen, rewards, ends)))


def _rollout(observations: Tensor, rewards: Tensor, truncated: Tensor) -> Rollout:
    """Return a rollout of which only the observations, rewards and ends are used."""
    nothing, last = torch.zeros_like(rewards), observations[-1]
    places = torch.zeros(*rewards.shape, 0, dtype=torch.int64, device=rewards.device)
    return Rollout(
        observations=observations,
        actions=nothing.long(),
        rewards=rewards,
        terminated=torch.zeros_like(truncated),
        truncated=truncated,
        values=nothing,
        log_probs=nothing,
        last_observations=last,
        final_observations=last[:0],
        positions=places,
        next_positions=places,
    )


def main(seed: int, trainings: int, device: str, **hyperparameters: Any) -> None:
    """Print a row for each training: what the network scored before it, and its loss in it."""
    envs: Any = gymnasium.make_vec("SPRL/MazeGoalSmall-v1", num_envs=NUM_ENVS, num_threads=1)
    config = ReachabilityConfig.pick({**preset("dmlab", "table", "sprl"), **hyperparameters})
    setting = Setting(envs.single_observation_space, envs.single_action_space, NUM_ENVS, seed, torch.device(device))
    network = LearnedReachability(setting, config)
    began, steps, done = time.monotonic(), 0, 0
    print("| trainings before | env steps | accuracy | loss in the next | seconds | seconds of the processor |")
    print("| ---: | ---: | ---: | ---: | ---: | ---: |")
    for rollout in rollouts(envs, seed, device):
        metrics = network.update(rollout)
        steps += rollout.num_steps
        if "reachability_loss" in metrics:
            accuracy, loss = metrics["reachability_accuracy"], metrics["reachability_loss"]
            spent = f"{time.monotonic() - began:.0f} | {time.process_time():.0f}"
            print(f"| {done} | {steps:,} | {accuracy:.3f} | {loss:.3f} | {spent} |", flush=True)
            done += 1
        if done > trainings:
            return


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=120)
    parser.add_argument("--trainings", type=int, default=5)
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--negatives", choices=NEGATIVES, default="episode")
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    main(arguments.seed, arguments.trainings, arguments.device, negatives=arguments.negatives)
