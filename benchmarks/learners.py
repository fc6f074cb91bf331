"""Two contenders that act and learn: our PPO, and Stable-Baselines3's with the same settings.

A turn is one rollout and one update.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import gymnasium
import torch
from gymnasium.vector import VectorEnv

from benchmarks.measure import Contender
from sprl_baselines.agents import ppo

Settings = Mapping[str, Any]


def turn_steps(settings: Settings) -> int:
    """Return the env steps of a turn."""
    steps: int = settings["num_envs"] * settings["rollout_length"]
    return steps


def threads(count: int) -> str:
    """Return how a row names a number of torch threads."""
    return f"{count} thread" + "s" * (count > 1)


def our_ppo(envs: VectorEnv[Any, Any, Any], settings: Settings, num_threads: int) -> Contender:
    """Return turns of our learner."""
    envs.reset(seed=0)
    updates = ppo(seed=0, **settings).train(envs, budget=10**9)

    def turn() -> int:
        torch.set_num_threads(num_threads)
        next(updates)
        return turn_steps(settings)

    return turn


def sb3_ppo(
    make: Callable[[], gymnasium.Env[Any, Any]],
    policy: str,
    policy_kwargs: Mapping[str, Any],
    settings: Settings,
    num_threads: int,
) -> Contender:
    """Return turns of Stable-Baselines3's learner on its `DummyVecEnv`, with the settings that both know."""
    from stable_baselines3 import PPO  # noqa: PLC0415 - optional
    from stable_baselines3.common.vec_env import DummyVecEnv  # noqa: PLC0415 - an extra

    model = PPO(
        policy,
        DummyVecEnv([make] * settings["num_envs"]),
        learning_rate=settings["learning_rate"],
        n_steps=settings["rollout_length"],
        batch_size=turn_steps(settings) // settings["minibatches"],
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
        torch.set_num_threads(num_threads)
        model.learn(turn_steps(settings), reset_num_timesteps=False)
        return turn_steps(settings)

    return turn
