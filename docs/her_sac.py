"""SAC with hindsight experience replay on a Fetch task, from Stable-Baselines3 as it is, scored by the recorder.

    pip install 'sprl-bench[fetch]' stable-baselines3
    python her_sac.py --suite fetch-sparse --task FetchReach-substep2 --seed 0 --out runs

HER relabels episodes with goals that they did reach, for which it calls the environment's `compute_reward`: it uses
more than an ordinary agent does. The settings are those that Stable-Baselines3's users share for FetchReach. With
`--discount-per reference-action` an action at substep 2 is discounted by .95 to the power of 2/20, so that the
horizon in simulated time stays the same. With 12 environments 500,000 steps take about a quarter of an hour.
"""

from __future__ import annotations

import argparse

import torch
from stable_baselines3 import SAC, HerReplayBuffer
from stable_baselines3.common.env_util import make_vec_env

import sprl_bench
from sprl_bench.tasks import Task, find_suite

GAMMA = 0.95


def settings(task: Task, discount_per: str) -> dict[str, float]:
    """Return the hyperparameters that a record notes."""
    action_time = task.arguments.get("substep", 20) / 20 if discount_per == "reference-action" else 1
    return {
        "gamma": GAMMA**action_time,
        "learning_rate": 0.001,
        "tau": 0.05,
        "batch_size": 256,
        "buffer_size": 1_000_000,
    }


def main() -> None:
    """Train one run and write its record."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--suite", default="fetch-sparse")
    parser.add_argument("--task", default="FetchReach-substep2")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", default="runs")
    parser.add_argument("--budget", type=int, default=None, help="env steps; by default the task's")
    parser.add_argument(
        "--num-envs", type=int, default=12, help="each step of all of them is followed by one gradient step"
    )
    parser.add_argument("--discount-per", choices=["action", "reference-action"], default="action")
    chosen = parser.parse_args()
    torch.set_num_threads(1)
    task = find_suite(chosen.suite).task(chosen.task)
    budget = chosen.budget or task.budget
    hyperparameters = settings(task, chosen.discount_per)
    agent = "her-sac" if chosen.discount_per == "action" else "her-sac-per-reference-action"
    with sprl_bench.recording(
        out=chosen.out,
        agent=agent,
        seed=chosen.seed,
        suite=chosen.suite if budget == task.budget else None,
        budget=budget,
        information=["relabelling"],
        hyperparameters=hyperparameters,
    ):
        arguments = {**task.arguments, "observation": "goal"}
        envs = make_vec_env(task.env_id, n_envs=chosen.num_envs, seed=chosen.seed, env_kwargs=arguments)
        model = SAC(
            "MultiInputPolicy",
            envs,
            replay_buffer_class=HerReplayBuffer,
            replay_buffer_kwargs={"n_sampled_goal": 4, "goal_selection_strategy": "future"},
            policy_kwargs={"net_arch": [64, 64]},
            learning_starts=1_000,
            seed=chosen.seed,
            device="cpu",
            **hyperparameters,
        )
        model.learn(budget)


if __name__ == "__main__":
    main()
