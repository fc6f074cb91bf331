"""PPO end to end, acting and learning, against Stable-Baselines3's and against the processor's matrix products.

Both learners train the network of appendix D.3 on FourRooms 7x7 with the same sub-environments, rollouts, epochs,
minibatches and number of torch threads. Each runs as its users run it: ours on the batched engine, theirs on the single
environment in a `DummyVecEnv`.

Our learner computes an observation that repeats within a minibatch once, so its rate falls as the policy learns to
waste fewer steps. Hence a row in which no observation ever repeats: the least that a policy can make of it.
"""

from __future__ import annotations

import importlib.util
from math import prod
from typing import Any

import gymnasium
import numpy as np
import numpy.typing as npt
import torch
from gymnasium.vector import VectorEnv, VectorWrapper
from torch import nn
from torch.nn import functional

import sprl_bench  # noqa: F401 - registers the ids
from benchmarks.learners import our_ppo, sb3_ppo, threads, turn_steps
from benchmarks.measure import Contender, Row, compare, missing, table
from sprl_baselines.agents import ppo
from sprl_baselines.learning.networks import LARGEST_CODES

TASK = "SPRL/FourRooms-7x7-v1"
SETTINGS = ppo.hyperparameters("grid", {})
BAR, SHARE_OF_LIMIT = 4, 0.35
REPEATS = 5

# Multiplications and additions for one observation: three convolutions, the wide layer, the two heads.
CELLS, UNITS, ACTIONS = 7 * 7, 512, 7
CONVOLUTIONS = ((3, 16), (32, 8), (16, 8))  # channels in and out, each with a 2x2 kernel
FORWARD = 2 * (CELLS * sum(4 * prod(pair) for pair in CONVOLUTIONS) + CELLS * 16 * UNITS + 2 * UNITS * (ACTIONS + 1))
WORK_PER_STEP = FORWARD * (1 + 3 * SETTINGS["epochs"])  # act once; a gradient costs three times a forward pass


def rows() -> list[Row]:
    """Measure all rows; takes a few minutes."""
    torch.set_flush_denormal(True)
    against = [_against_sb3(count) for count in (1, 2)]
    return [*against, _against_sb3(1, repeats_observations=False), *(_against_the_limit(count) for count in (1, 2))]


def main() -> None:
    """Print the table."""
    print(table(rows()))


def _against_sb3(num_threads: int, *, repeats_observations: bool = True) -> Row:
    what = f"PPO, FourRooms 7x7, {threads(num_threads)}" + ("" if repeats_observations else ", no observation repeats")
    against = f"Stable-Baselines3 on DummyVecEnv, {threads(num_threads)}"
    if importlib.util.find_spec("stable_baselines3") is None:
        return missing(what, against, bar=BAR)
    ours = _ours(num_threads, repeats_observations=repeats_observations)
    return compare(what, ours, against, _sb3(num_threads), bar=BAR, repeats=REPEATS)


def _against_the_limit(num_threads: int) -> Row:
    what = f"PPO, FourRooms 7x7, {threads(num_threads)}, no observation repeats"
    against = f"the matrix products that every step needs, {WORK_PER_STEP / 1e6:.1f} MFLOP"
    ours = _ours(num_threads, repeats_observations=False)
    return compare(what, ours, against, _products(num_threads), bar=SHARE_OF_LIMIT, repeats=REPEATS)


def _ours(num_threads: int, *, repeats_observations: bool) -> Contender:
    envs: VectorEnv[Any, Any, Any] = gymnasium.make_vec(TASK, num_envs=SETTINGS["num_envs"], num_threads=1)
    return our_ppo(envs if repeats_observations else Numbered(envs), SETTINGS, num_threads)


class Numbered(VectorWrapper[Any, Any, Any]):
    """Writes a running number, in digits below 8, into the upper wall, so that no observation occurs twice."""

    def __init__(self, envs: VectorEnv[Any, Any, Any]) -> None:
        super().__init__(envs)
        self._count = 0

    def reset(self, **arguments: Any) -> tuple[Any, dict[str, Any]]:
        """Reset, and number the observations."""
        observations, infos = self.env.reset(**arguments)
        return self._numbered(observations), infos

    def step(self, actions: Any) -> tuple[Any, Any, Any, Any, dict[str, Any]]:
        """Step, and number the observations."""
        observations, *rest = self.env.step(actions)
        return self._numbered(observations), *rest

    def _numbered(self, observations: npt.NDArray[np.uint8]) -> npt.NDArray[np.uint8]:
        """Number the observations `[N, H, W, 3]`, in place."""
        numbers = self._count + np.arange(len(observations))
        self._count += len(observations)
        width = observations.shape[2]
        observations[:, 0, :, 1] = numbers[:, None] // 8 ** np.arange(width) % 8
        return observations


def _sb3(num_threads: int) -> Contender:
    from stable_baselines3.common.torch_layers import BaseFeaturesExtractor  # noqa: PLC0415 - optional

    class AppendixNetwork(BaseFeaturesExtractor):  # type: ignore[misc,unused-ignore]  # untyped where it is not installed
        """The same layers in the plainest form; SB3 hands over images with their channels first."""

        def __init__(self, space: gymnasium.spaces.Box) -> None:
            super().__init__(space, 2 * UNITS)
            self.scale = nn.Parameter(torch.tensor(LARGEST_CODES).view(1, 3, 1, 1).float(), requires_grad=False)
            self.convolutions = nn.ModuleList(nn.Conv2d(*pair, 2) for pair in CONVOLUTIONS)
            self.wide = nn.Linear(CELLS * 16, UNITS)

        def forward(self, images: torch.Tensor) -> torch.Tensor:
            """`[B, 3, 7, 7]` -> `[B, 1024]`."""
            images = images / self.scale
            for convolution in self.convolutions:
                images = convolution(functional.pad(images, (0, 1, 0, 1)))
                images = torch.relu(torch.cat((images, -images), dim=1))
            responses = self.wide(images.flatten(1))
            return torch.relu(torch.cat((responses, -responses), dim=1))

    network = {"features_extractor_class": AppendixNetwork, "net_arch": [], "normalize_images": False}
    return sb3_ppo(lambda: gymnasium.make(TASK), "CnnPolicy", network, SETTINGS, num_threads)


def _products(num_threads: int) -> Contender:
    """Return nothing but the widest layer's product, as often as one turn's arithmetic asks for."""
    batch = turn_steps(SETTINGS) // SETTINGS["minibatches"]
    left, right = torch.randn(batch, CELLS * 16), torch.randn(CELLS * 16, UNITS)
    times = round(turn_steps(SETTINGS) * WORK_PER_STEP / (2 * batch * CELLS * 16 * UNITS))

    def turn() -> int:
        torch.set_num_threads(num_threads)
        for _ in range(times):
            left @ right
        return turn_steps(SETTINGS)

    return turn


if __name__ == "__main__":
    main()
