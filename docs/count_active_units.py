"""Count the hidden units that trained policies still use: `python docs/count_active_units.py RUNS`.

A rectified unit whose input is below 0 for every observation gives 0, gets no gradient, and is lost. For each finished
run of a grid agent this counts the units of the policy's last hidden layer that are above 0 on any of the observations
that a uniformly random policy meets, and prints them as a table: an agent and task a row, a seed a column.
"""

from __future__ import annotations

import sys
from collections import defaultdict
from functools import cache
from pathlib import Path

import gymnasium
import numpy as np
import torch
from torch import Tensor

from sprl_baselines.ppo import PPO, PPOConfig
from sprl_bench import checkpoint
from sprl_bench.recorder.folder import WEIGHTS
from sprl_bench.records import RunRecord, find_records

NUM_ENVS, STEPS = 12, 100


@cache
def experience(env_id: str) -> Tensor:
    """Return the observations `[B, H, W, 3]` that random actions meet."""
    envs = gymnasium.make_vec(env_id, num_envs=NUM_ENVS)
    envs.action_space.seed(0)
    observations = [envs.reset(seed=0)[0].copy()]
    observations += [envs.step(envs.action_space.sample())[0].copy() for _ in range(STEPS)]
    return torch.from_numpy(np.concatenate(observations))


def active_units(record: RunRecord, root: Path) -> int:
    """Return how many units of a run's last hidden layer are above 0 on any observation."""
    env = gymnasium.make(record.spec.task.env_id)
    config = PPOConfig.pick(record.spec.hyperparameters)
    learner = PPO(env.observation_space, env.action_space, config, 0, torch.device("cpu"))
    weights = checkpoint.load(record.spec.path(root) / WEIGHTS)
    learner.network.load_state_dict(weights["agent"]["learner"]["network"])
    with torch.inference_mode():
        features = learner.network.policy_trunk(experience(record.spec.task.env_id))
    return int((features > 0).any(dim=0).sum())


def main(root: str) -> None:
    """Print the table of all runs."""
    counts: dict[tuple[str, str], dict[int, int]] = defaultdict(dict)
    for record in find_records(Path(root)):
        if record.spec.agent != "random":
            counts[record.spec.task.name, record.spec.agent][record.spec.seed] = active_units(record, Path(root))
    for (task, agent), of_seeds in sorted(counts.items()):
        print(f"| {task} | `{agent}` | {' | '.join(str(of_seeds[seed]) for seed in sorted(of_seeds))} |")


if __name__ == "__main__":
    main(*sys.argv[1:2])
