"""Contenders that act and learn: our PPO, Stable-Baselines3's and SBX's with the same settings.

A turn is one rollout and one update.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import gymnasium
import torch
from gymnasium.vector import VectorEnv

from benchmarks.jax_cores import limit_jax
from benchmarks.turns import Turn
from sprl_baselines.agents import ppo

Settings = Mapping[str, Any]
Maker = Callable[[], gymnasium.Env[Any, Any]]


def turn_steps(settings: Settings) -> int:
    """Return the env steps of a turn."""
    steps: int = settings["num_envs"] * settings["rollout_length"]
    return steps


def minibatch_size(settings: Settings) -> int:
    """Return the samples of a gradient step."""
    size: int = turn_steps(settings) // settings["minibatches"]
    return size


def threads(count: int) -> str:
    """Return how a row names a number of threads."""
    return f"{count} thread" + "s" * (count > 1)


def set_up_torch(num_threads: int) -> None:
    """Set torch up as the harness does, for everyone that uses it."""
    torch.set_num_threads(num_threads)
    torch.set_flush_denormal(True)


def our_ppo(envs: VectorEnv[Any, Any, Any], settings: Settings, num_threads: int) -> Turn:
    """Return turns of our learner."""
    set_up_torch(num_threads)
    envs.reset(seed=0)
    updates = ppo(seed=0, **settings).train(envs, budget=10**9)

    def turn() -> int:
        next(updates)
        return turn_steps(settings)

    return turn


def sb3_ppo(make: Maker, policy: str, policy_kwargs: Settings, settings: Settings, num_threads: int) -> Turn:
    """Return turns of Stable-Baselines3's learner on its `DummyVecEnv`."""
    set_up_torch(num_threads)
    from stable_baselines3 import PPO  # noqa: PLC0415 - optional

    return _stable_baselines_ppo(PPO, make, policy, policy_kwargs, settings)


def sbx_ppo(make: Maker, network: Callable[[], Settings], settings: Settings, num_threads: int) -> Turn:
    """Return turns of SBX's learner, which is Stable-Baselines3's in JAX; policy and value share no layers there.

    The network is made by a function, so that JAX is imported after it has been limited.
    """
    limit_jax(num_threads)
    set_up_torch(num_threads)
    from sbx import PPO  # noqa: PLC0415 - optional

    return _stable_baselines_ppo(PPO, make, "MlpPolicy", network(), settings)


def _stable_baselines_ppo(learner: Any, make: Maker, policy: str, policy_kwargs: Settings, settings: Settings) -> Turn:
    """Return turns of a learner with Stable-Baselines3's interface, with the settings that both it and ours know."""
    from stable_baselines3.common.vec_env import DummyVecEnv  # noqa: PLC0415 - optional

    model = learner(
        policy,
        DummyVecEnv([make] * settings["num_envs"]),
        learning_rate=settings["learning_rate"],
        n_steps=settings["rollout_length"],
        batch_size=minibatch_size(settings),
        n_epochs=settings["epochs"],
        gamma=settings["gamma"],
        gae_lambda=settings["gae_lambda"],
        clip_range=settings["clip_range"],
        clip_range_vf=settings["clip_range"],
        ent_coef=settings["entropy_coefficient"],
        policy_kwargs=dict(policy_kwargs),
        seed=0,
        device="cpu",
    )

    def turn() -> int:
        model.learn(turn_steps(settings), reset_num_timesteps=False)
        return turn_steps(settings)

    return turn
