"""How separable are the pairs of notes/maze-accuracy.md? `python notes/maze_accuracy_ceiling.py`.

A small network sees the true relative pose of two states of a uniformly random policy in GoalSmall, which no picture
shows so exactly. Its accuracy on held-out pairs, at the distances of appendix B.1, is what a picture can hardly exceed.
"""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
import torch
from torch import Tensor, nn
from torch.nn.functional import binary_cross_entropy_with_logits

import sprl_bench  # noqa: F401 - registers the ids

NUM_ENVS, STEPS, PAIRS, SEED = 12, 1_300, 15_000, 120
POSITIVE, NEGATIVE = (1, 11), (31, 51)  # steps between the states of a pair, for k = 10
CELL, TURN = 65_536, 4_096  # units of a cell and of a full turn in a pose

Walks = tuple[np.ndarray, np.ndarray]


def walks() -> Walks:
    """Return poses (x, y in cells, angle) [T, N, 3] and the rewards until then [T, N]."""
    envs: Any = gymnasium.make_vec("SPRL/MazeGoalSmall-v1", num_envs=NUM_ENVS, num_threads=1)
    generator = np.random.default_rng(SEED)
    envs.reset(seed=SEED)
    poses, paid = [], []
    for _ in range(STEPS):
        poses.append(envs.mazes.worlds.poses[:, :3] / (CELL, CELL, TURN / (2 * np.pi)))
        paid.append(envs.step(generator.integers(0, 9, NUM_ENVS))[1] > 0)
    return np.stack(poses), np.cumsum(paid, axis=0)


def pairs(walked: Walks, between: tuple[int, int], generator: np.random.Generator) -> np.ndarray:
    """Return the later pose as the earlier one sees it, [P, 6]; pairs with a reward between them are left out."""
    poses, paid = walked
    earlier = generator.integers(0, STEPS - NEGATIVE[1] - 1, PAIRS)
    later = earlier + generator.integers(between[0], between[1] + 1, PAIRS)
    env = generator.integers(0, NUM_ENVS, PAIRS)
    kept = paid[earlier, env] == paid[later - 1, env]
    moved = (poses[later, env] - poses[earlier, env])[kept]
    angle = poses[earlier, env, 2][kept]
    ahead = moved[:, 0] * np.cos(angle) + moved[:, 1] * np.sin(angle)
    aside = moved[:, 1] * np.cos(angle) - moved[:, 0] * np.sin(angle)
    turned = np.abs((moved[:, 2] + np.pi) % (2 * np.pi) - np.pi)
    return np.column_stack([ahead, aside, np.abs(ahead), np.abs(aside), turned, np.hypot(ahead, aside)])


def accuracy(near: np.ndarray, far: np.ndarray) -> float:
    """Train a network on two thirds of the pairs and return its accuracy on the others."""
    torch.manual_seed(SEED)
    inputs = torch.tensor(np.concatenate([near, far]), dtype=torch.float32)
    targets = torch.cat((torch.zeros(len(near)), torch.ones(len(far))))
    order = torch.randperm(len(inputs))
    training, held_out = order[: 2 * len(order) // 3], order[2 * len(order) // 3 :]
    network = nn.Sequential(nn.Linear(6, 64), nn.ReLU(), nn.Linear(64, 64), nn.ReLU(), nn.Linear(64, 1))
    optimizer = torch.optim.Adam(network.parameters(), 2e-3)

    def logits(rows: Tensor) -> Tensor:
        answers: Tensor = network(inputs[rows])[:, 0]
        return answers

    for _ in range(15):
        for batch in training[torch.randperm(len(training))].split(256):
            optimizer.zero_grad()
            binary_cross_entropy_with_logits(logits(batch), targets[batch]).backward()
            optimizer.step()
    return float(((logits(held_out) > 0) == (targets[held_out] > 0)).float().mean())


if __name__ == "__main__":
    walked, generator = walks(), np.random.default_rng(SEED)
    near, far = pairs(walked, POSITIVE, generator), pairs(walked, NEGATIVE, generator)
    print(f"Median distance: {np.median(near[:, 5]):.2f} and {np.median(far[:, 5]):.2f} cells.")
    print(f"Accuracy on the true relative pose: {accuracy(near, far):.3f}.")
