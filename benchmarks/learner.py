"""PPO end to end on FourRooms 7x7, acting and learning, against other learners and against its matrix products.

All learners train the network of appendix D.3 with the same sub-environments, rollouts, epochs and minibatches. Each
runs as its users run it: ours on the batched engine, Stable-Baselines3's (torch) and SBX's (JAX) on the single
environment in a `DummyVecEnv`. SBX shares no layers between policy and value, so it computes the network twice.

Our learner computes an observation that repeats within a minibatch once, so its rate falls as the policy learns to
waste fewer steps. Hence the rows in which no observation ever repeats: the least that a policy can make of it.
"""

from __future__ import annotations

from math import prod
from typing import Any

import gymnasium
import numpy as np
import numpy.typing as npt
from gymnasium.vector import VectorEnv, VectorWrapper

import sprl_bench  # noqa: F401 - registers the ids
from benchmarks.appendix_network import CELLS, CONVOLUTIONS, UNITS, flax_network, torch_network
from benchmarks.contenders import contender, optional
from benchmarks.learners import minibatch_size, our_ppo, sb3_ppo, sbx_ppo, set_up_torch, threads, turn_steps
from benchmarks.measure import Row, compare
from benchmarks.products import flops, multiplier
from benchmarks.turns import Turn
from sprl_baselines.agents import ppo

TASK = "SPRL/FourRooms-7x7-v1"
SETTINGS = ppo.hyperparameters("grid", {})
SB3_BAR, SBX_BAR = 4, 2
LIMIT_BARS = {1: 0.55, 2: 0.45}  # by number of threads
REPEATS = 5

# Multiplications and additions for one observation: three convolutions, the wide layer, the two heads.
ACTIONS = 7
WIDE = (minibatch_size(SETTINGS), CELLS * 16, UNITS)  # the wide layer's product, which is nearly all
FORWARD = 2 * (CELLS * sum(4 * prod(pair) for pair in CONVOLUTIONS) + CELLS * 16 * UNITS + 2 * UNITS * (ACTIONS + 1))
WORK_PER_STEP = FORWARD * (1 + 3 * SETTINGS["epochs"])  # act once; a gradient costs three times a forward pass


def rows() -> list[Row]:
    """Measure all rows; takes a few minutes."""
    return [
        *(_against_sb3(num_threads, repeating=True) for num_threads in (1, 2)),
        _against_sb3(1, repeating=False),
        *(_against_sbx(num_threads) for num_threads in (1, 2)),
        *(_against_the_limit(num_threads) for num_threads in LIMIT_BARS),
    ]


def _what(num_threads: int, *, repeating: bool) -> str:
    return f"PPO, FourRooms 7x7, {threads(num_threads)}" + ("" if repeating else ", no observation repeats")


def _against_sb3(num_threads: int, *, repeating: bool) -> Row:
    return compare(
        _what(num_threads, repeating=repeating),
        contender(ours, num_threads=num_threads, repeating=repeating),
        f"Stable-Baselines3, DummyVecEnv, {threads(num_threads)}",
        optional("stable_baselines3", "stable-baselines3", sb3, num_threads=num_threads),
        bar=SB3_BAR,
        repeats=REPEATS,
    )


def _against_sbx(num_threads: int) -> Row:
    return compare(
        _what(num_threads, repeating=True),
        contender(ours, num_threads=num_threads, repeating=True),
        f"SBX (JAX), DummyVecEnv, {threads(num_threads)}",
        optional("sbx", "sbx-rl", sbx, num_threads=num_threads),
        bar=SBX_BAR,
        repeats=REPEATS,
    )


def _against_the_limit(num_threads: int) -> Row:
    return compare(
        _what(num_threads, repeating=False),
        contender(ours, num_threads=num_threads, repeating=False),
        f"the matrix products that every step needs, {WORK_PER_STEP / 1e6:.1f} MFLOP, {threads(num_threads)}",
        contender(products, num_threads=num_threads),
        bar=LIMIT_BARS[num_threads],
        repeats=REPEATS,
    )


def ours(num_threads: int, repeating: bool) -> Turn:
    """Return turns of our learner, with observations that repeat or without."""
    envs: VectorEnv[Any, Any, Any] = gymnasium.make_vec(TASK, num_envs=SETTINGS["num_envs"], num_threads=1)
    return our_ppo(envs if repeating else Numbered(envs), SETTINGS, num_threads)


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


def sb3(num_threads: int) -> Turn:
    """Return turns of Stable-Baselines3's learner."""
    network = {"features_extractor_class": torch_network(), "net_arch": [], "normalize_images": False}
    return sb3_ppo(_single, "CnnPolicy", network, SETTINGS, num_threads)


def sbx(num_threads: int) -> Turn:
    """Return turns of SBX's learner."""
    return sbx_ppo(_single, lambda: {"features_extractor_class": flax_network(), "net_arch": []}, SETTINGS, num_threads)


def _single() -> gymnasium.Env[Any, Any]:
    return gymnasium.make(TASK)


def products(num_threads: int) -> Turn:
    """Return nothing but the widest layer's product, as often as one turn's arithmetic asks for."""
    set_up_torch(num_threads)
    multiply = multiplier([WIDE] * round(turn_steps(SETTINGS) * WORK_PER_STEP / flops([WIDE])))

    def turn() -> int:
        multiply()
        return turn_steps(SETTINGS)

    return turn
