"""PPO end to end on FetchReach at substep 3, acting and learning, against other learners and against its limit.

All learners train two MLPs of 4 x 256 with the same sub-environments, rollouts, epochs and minibatches. Ours steps the
batched engine; Stable-Baselines3's (torch) and SBX's (JAX) step Gymnasium-Robotics' own environment, mended to run on
this MuJoCo, in a `DummyVecEnv`. Nobody ends an episode at the goal, and only ours normalises observations. On two
threads ours must outrun Stable-Baselines3 at its best, so there is a row for each number of its threads.

The limit is what no learner of these networks on this simulator can save: MuJoCo's own batch stepping of one rollout,
and the matrix products of acting and of the update at their batch sizes.
"""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
import numpy.typing as npt
from gymnasium.wrappers import TimeLimit
from torch import nn

import sprl_bench  # noqa: F401 - registers the ids
from benchmarks.contenders import contender, optional
from benchmarks.fetch import RawPhysics
from benchmarks.learners import minibatch_size, our_ppo, sb3_ppo, sbx_ppo, set_up_torch, threads, turn_steps
from benchmarks.measure import Row, compare
from benchmarks.products import Product, flops, forward, gradient, multiplier
from benchmarks.turns import Turn
from sprl_baselines.agents import ppo
from sprl_bench.envs.fetch.simulation import new_simulation

TASK, SUBSTEP = "Reach", 3
EPISODE = round(1000 / SUBSTEP)
SETTINGS = ppo.hyperparameters("fetch", {})
SB3_BAR, SBX_BAR, LIMIT_BAR = 5, 2, 0.7
REPEATS = 5

OBSERVATION, ACTION = 10 + 3 + 3, 4  # numbers in each
HIDDEN = [SETTINGS["mlp_units"]] * SETTINGS["mlp_layers"]
POLICY, VALUE = (OBSERVATION, *HIDDEN, ACTION), (OBSERVATION, *HIDDEN, 1)  # widths


def rows() -> list[Row]:
    """Measure all rows; takes a few minutes."""
    return [
        *(_against_sb3(num_threads) for num_threads in (1, 2)),
        *(_against_sbx(num_threads) for num_threads in (1, 2)),
        _against_the_limit(),
    ]


def _what(num_threads: int) -> str:
    return f"PPO, Fetch{TASK}, substep {SUBSTEP}, {threads(num_threads)}"


def _against_sb3(their_threads: int) -> Row:
    return compare(
        _what(2),
        contender(ours, num_threads=2),
        f"Stable-Baselines3 on gymnasium-robotics, flat observation, {threads(their_threads)}",
        optional("stable_baselines3", "stable-baselines3", sb3, num_threads=their_threads),
        bar=SB3_BAR,
        repeats=REPEATS,
    )


def _against_sbx(num_threads: int) -> Row:
    return compare(
        _what(num_threads),
        contender(ours, num_threads=num_threads),
        f"SBX (JAX) on gymnasium-robotics, flat observation, {threads(num_threads)}",
        optional("sbx", "sbx-rl", sbx, num_threads=num_threads),
        bar=SBX_BAR,
        repeats=REPEATS,
    )


def _against_the_limit() -> Row:
    work = flops(products_of_a_turn()) / turn_steps(SETTINGS) / 1e6
    return compare(
        _what(1),
        contender(ours, num_threads=1),
        f"its limit: raw physics, and the matrix products, {work:.1f} MFLOP a step, {threads(1)}",
        contender(limit),
        bar=LIMIT_BAR,
        repeats=REPEATS,
    )


def ours(num_threads: int) -> Turn:
    """Return turns of our learner."""
    envs: Any = gymnasium.make_vec(
        f"SPRL/Fetch{TASK}Sparse-v1",
        SETTINGS["num_envs"],
        num_threads=num_threads,
        substep=SUBSTEP,
        terminate_on_goal=False,
    )
    return our_ppo(envs, SETTINGS, num_threads)


def sb3(num_threads: int) -> Turn:
    """Return turns of Stable-Baselines3's learner."""
    network = {"net_arch": {"pi": HIDDEN, "vf": HIDDEN}, "activation_fn": nn.ReLU}
    return sb3_ppo(_upstream, "MlpPolicy", network, SETTINGS, num_threads)


def sbx(num_threads: int) -> Turn:
    """Return turns of SBX's learner."""
    return sbx_ppo(_upstream, _sbx_network, SETTINGS, num_threads)


def _sbx_network() -> dict[str, Any]:
    import flax.linen  # noqa: PLC0415 - optional

    return {"net_arch": {"pi": HIDDEN, "vf": HIDDEN}, "activation_fn": flax.linen.relu}


def _upstream() -> gymnasium.Env[Any, Any]:
    return Joined(TimeLimit(new_simulation(TASK, SUBSTEP), EPISODE))


class Joined(gymnasium.ObservationWrapper[Any, Any, Any]):
    """Joins the three parts of an observation in one call; Gymnasium's `FlattenObservation` is slower."""

    def __init__(self, env: gymnasium.Env[Any, Any]) -> None:
        super().__init__(env)
        self.observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (OBSERVATION,), np.float32)

    def observation(self, observation: dict[str, npt.NDArray[np.float64]]) -> npt.NDArray[np.float32]:
        """Return the parts as one array `[16]`."""
        return np.concatenate(list(observation.values()), dtype=np.float32)


def products_of_a_turn() -> list[Product]:
    """Return the matrix products of a turn: act in every step, all values at once, then the gradients."""
    act = forward(POLICY, SETTINGS["num_envs"]) * SETTINGS["rollout_length"]
    values = forward(VALUE, turn_steps(SETTINGS))
    step = [product for widths in (POLICY, VALUE) for product in gradient(widths, minibatch_size(SETTINGS))]
    return [*act, *values, *step * (SETTINGS["epochs"] * SETTINGS["minibatches"])]


def limit() -> Turn:
    """Return turns of the least that a learner must compute, on one thread."""
    set_up_torch(1)
    physics = RawPhysics(TASK, SUBSTEP, num_envs=SETTINGS["num_envs"], num_threads=1, steps=SETTINGS["rollout_length"])
    multiply = multiplier(products_of_a_turn())

    def turn() -> int:
        multiply()
        return physics()

    return turn
