"""The arithmetic of the limits, and that the peers learn what ours does."""

from __future__ import annotations

import importlib.util
import os
import subprocess
import sys
from typing import Any

import gymnasium
import numpy as np
import pytest
import torch
from torch import nn

import sprl_bench  # noqa: F401 - registers the ids
from benchmarks import fetch, fetch_learner, grid, learner, maze
from benchmarks.appendix_network import torch_network
from benchmarks.contenders import ROOT
from benchmarks.learners import turn_steps
from benchmarks.products import flops, forward, gradient, multiplier
from sprl_baselines.learning.networks import actor_critic


def test_products_of_a_small_network() -> None:
    widths = (2, 3, 5)
    assert forward(widths, 7) == [(7, 2, 3), (7, 3, 5)]
    assert flops(forward(widths, 7)) == 2 * 7 * (6 + 15)
    assert gradient(widths, 7) == [(7, 2, 3), (7, 3, 5), (2, 7, 3), (3, 7, 5), (7, 5, 3)]
    assert flops(gradient(widths, 7)) == 3 * flops(forward(widths, 7)) - 2 * 7 * 6  # the input needs no gradient


def test_the_products_are_computed_in_their_order_each_as_often_as_it_is_listed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    computed = []

    def multiplied(left: torch.Tensor, right: torch.Tensor, out: torch.Tensor) -> None:
        assert out.shape == (len(left), right.shape[1])
        computed.append((*left.shape, right.shape[1]))

    multiply = multiplier([(1, 2, 3), (4, 5, 6), (1, 2, 3)])
    monkeypatch.setattr(torch, "mm", multiplied)
    multiply()
    assert computed == [(1, 2, 3), (4, 5, 6), (1, 2, 3)]


def test_the_work_of_an_env_step_is_what_its_network_makes_it() -> None:
    """Two MLPs act or are evaluated once and get four gradients; the grid's network likewise."""
    parameters = 16 * 256 + 3 * 256 * 256 + 256 * 4, 16 * 256 + 3 * 256 * 256 + 256
    spared = 2 * 16 * 256  # the products for the gradient of the input
    expected = 2 * (13 * sum(parameters) - 4 * spared)
    assert flops(fetch_learner.products_of_a_turn()) == expected * turn_steps(fetch_learner.SETTINGS)
    assert expected == pytest.approx(10.5e6, rel=0.01)
    assert learner.WORK_PER_STEP == 12_851_072


@pytest.mark.skipif(importlib.util.find_spec("stable_baselines3") is None, reason="needs stable-baselines3")
def test_the_peers_train_a_network_of_our_size() -> None:
    """Up to the scale of the cells, which is no parameter of ours, and the value's and the policy's heads."""

    def trained(network: nn.Module) -> int:
        return sum(parameter.numel() for parameter in network.parameters() if parameter.requires_grad)

    env = gymnasium.make(learner.TASK)
    ours = actor_critic(env.observation_space, env.action_space, torch.Generator().manual_seed(0))
    theirs: Any = torch_network()(gymnasium.spaces.Box(0, 255, (3, 7, 7), np.uint8))
    assert trained(ours.policy_trunk) == trained(theirs)
    assert theirs(torch.zeros(2, 3, 7, 7)).shape == (2, 1024)


def test_the_peers_see_what_ours_sees() -> None:
    theirs = fetch_learner._upstream()
    observation, _ = theirs.reset(seed=0)
    assert observation.shape == (fetch_learner.OBSERVATION,)
    assert theirs.observation_space.contains(observation)
    ours = gymnasium.make_vec("SPRL/FetchReachSparse-v1", num_envs=1)
    parts: Any = ours.single_observation_space
    assert gymnasium.spaces.flatdim(parts) == fetch_learner.OBSERVATION
    assert ours.single_action_space.shape == (fetch_learner.ACTION,)


def test_raw_physics_counts_its_steps() -> None:
    physics = fetch.RawPhysics("Reach", 3, num_envs=2, num_threads=1, steps=5)
    assert physics() == physics() == 10


@pytest.mark.parametrize("rows", [learner.rows, fetch_learner.rows, fetch.rows, grid.rows, maze.rows])
def test_peers_that_are_not_installed_are_named(rows: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """And nothing is started for them."""
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    monkeypatch.setenv("NAVIX_PYTHON", "/nowhere/python")
    started: list[Any] = []
    monkeypatch.setattr("benchmarks.measure.Process", _Idle(started))
    missing = [row for row in rows() if row.verdict == "Not measured"]
    needed = {row.against.partition("(needs ")[2].partition(": ")[0] for row in missing}
    assert needed == NEEDED[rows.__module__]
    assert len(started) == 2 * (ROWS[rows.__module__] - len(missing))


NEEDED = {
    "benchmarks.learner": {"stable-baselines3", "sbx-rl"},
    "benchmarks.fetch_learner": {"stable-baselines3", "sbx-rl"},
    "benchmarks.fetch": {"envpool"},
    "benchmarks.grid": {"envpool", "Python 3.12"},
    "benchmarks.maze": {"vizdoom"},
}
ROWS = {
    "benchmarks.learner": 7,
    "benchmarks.fetch_learner": 5,
    "benchmarks.fetch": 10,
    "benchmarks.grid": 3,
    "benchmarks.maze": 1,
}


class _Idle:
    """Starts nothing, and remembers what it should have started."""

    peak = 0

    def __init__(self, started: list[Any]) -> None:
        self._started = started

    def __call__(self, contender: Any) -> _Idle:
        self._started.append(contender)
        return self

    def __enter__(self) -> _Idle:
        return self

    def __exit__(self, *error: object) -> None:
        pass

    def turn(self) -> float:
        return 1.0


def test_a_peer_in_another_environment_needs_the_standard_library_alone() -> None:
    code = "import benchmarks.turns, benchmarks.navix_rooms"
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    subprocess.run([sys.executable, "-S", "-c", code], check=True, cwd=ROOT, env=environment)
