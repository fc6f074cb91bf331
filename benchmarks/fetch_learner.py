"""PPO end to end on FetchReach at substep 3, acting and learning, against Stable-Baselines3's on Gymnasium-Robotics.

Both learners train two MLPs of 4 x 256 with the same sub-environments, rollouts, epochs, minibatches and number of
torch threads. Ours steps the batched engine, theirs Gymnasium-Robotics' own environment, mended to run on this MuJoCo,
in a `DummyVecEnv`. Neither ends an episode at the goal.
"""

from __future__ import annotations

import importlib.util
from typing import Any

import gymnasium
import torch
from gymnasium.wrappers import FlattenObservation, TimeLimit
from torch import nn

import sprl_bench  # noqa: F401 - registers the ids
from benchmarks.learners import our_ppo, sb3_ppo, threads
from benchmarks.measure import Contender, Row, compare, missing, table
from sprl_baselines.agents import ppo
from sprl_bench.envs.fetch.simulation import new_simulation

TASK, SUBSTEP = "Reach", 3
SETTINGS = ppo.hyperparameters("fetch", {})
NUM_THREADS, BAR, REPEATS = 2, 5, 5


def rows() -> list[Row]:
    """Measure the row; takes a minute or two."""
    torch.set_flush_denormal(True)
    what = f"PPO, Fetch{TASK}, substep {SUBSTEP}, {threads(NUM_THREADS)}"
    against = f"Stable-Baselines3 on gymnasium-robotics, {threads(NUM_THREADS)}"
    if importlib.util.find_spec("stable_baselines3") is None:
        return [missing(what, against, bar=BAR)]
    return [compare(what, _ours(), against, _sb3(), bar=BAR, repeats=REPEATS)]


def main() -> None:
    """Print the table."""
    print(table(rows()))


def _ours() -> Contender:
    envs: Any = gymnasium.make_vec(
        f"SPRL/Fetch{TASK}Sparse-v1",
        SETTINGS["num_envs"],
        num_threads=NUM_THREADS,
        substep=SUBSTEP,
        terminate_on_goal=False,
    )
    return our_ppo(envs, SETTINGS, NUM_THREADS)


def _sb3() -> Contender:
    widths = [SETTINGS["mlp_units"]] * SETTINGS["mlp_layers"]
    network = {"net_arch": {"pi": widths, "vf": widths}, "activation_fn": nn.ReLU}
    return sb3_ppo(_upstream, "MlpPolicy", network, SETTINGS, NUM_THREADS)


def _upstream() -> gymnasium.Env[Any, Any]:
    return FlattenObservation(TimeLimit(new_simulation(TASK, SUBSTEP), round(1000 / SUBSTEP)))


if __name__ == "__main__":
    main()
