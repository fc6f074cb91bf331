"""RND: the normalised error of a predictor, on streams made by hand."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch
from gymnasium import spaces
from torch.testing import assert_close

from sprl_baselines.bonus import Setting
from sprl_baselines.learning.rollout import Rollout
from sprl_baselines.rnd import RND, RNDConfig

CPU = torch.device("cpu")
LINE = spaces.Box(-np.inf, np.inf, (2,), np.float64)


def rollout_of(successors: Any) -> Rollout:
    """Return steps of one sub-env through these states, `[T + 1, 2]`."""
    states = torch.as_tensor(np.asarray(successors, dtype=np.float64)).unsqueeze(1)
    steps = len(states) - 1
    nothing = torch.zeros(steps, 1)
    return Rollout(
        observations=states[:-1], actions=torch.zeros(steps, 1, dtype=torch.int64), rewards=nothing,
        terminated=nothing.bool(), truncated=nothing.bool(), values=nothing, log_probs=nothing,
        last_observations=states[-1], final_observations=states[:0, 0],
        positions=torch.zeros(steps, 1, 0), next_positions=torch.zeros(steps, 1, 0),
    )  # fmt: skip


def made(**hyperparameters: Any) -> RND:
    return RND(Setting(LINE, spaces.Discrete(2), 1, 0, CPU), RNDConfig(bonus_weight=1.0, **hyperparameters))


def around(center: tuple[float, float], steps: int = 64, seed: int = 0) -> Rollout:
    return rollout_of(np.random.default_rng(seed).normal(center, 0.1, size=(steps + 1, 2)))


def test_the_first_rollout_pays_nothing() -> None:
    assert not made().reward(around((0, 0))).any()


def test_what_was_often_seen_pays_less_than_what_is_new() -> None:
    bonus = made(rnd_learning_rate=0.001, rnd_epochs=4)
    here, there = around((0.0, 0.0)), around((0.0, 0.6), seed=1)
    for _ in range(60):
        bonus.update(here)
    assert float(bonus.reward(there).mean()) > 10 * float(bonus.reward(here).mean())


def test_the_bonus_is_the_error_over_the_deviation_of_its_discounted_sum() -> None:
    bonus = made(rnd_gamma=0.5)
    first, second = around((0, 0)), around((1, 0), seed=1)
    moments, sums, total = [], 0.0, []
    for rollout in (first, second):
        before = bonus.network.predictor[1].weight.detach().clone()
        metrics = bonus.update(rollout)
        assert not torch.equal(before, bonus.network.predictor[1].weight)
        moments.append(metrics["rnd_deviation"])
    # The sums again, from the errors that the bonus saw: its networks before each training, on all moments so far.
    again = made(rnd_gamma=0.5)
    for rollout in (first, second):
        again.network.view.update(rollout.next_observations.flatten(0, 1))
        for error in again._errors(rollout).double().flatten().tolist():
            sums = 0.5 * sums + error
            total.append(sums)
        again.load_state_dict(_after(bonus, first) if rollout is first else bonus.state_dict())
    assert moments[-1] == pytest.approx(float(np.std(total)), rel=1e-6)


def _after(bonus: RND, rollout: Rollout) -> Any:
    """Return the state of a bonus of the same seed after one update."""
    twin = made(rnd_gamma=0.5)
    twin.update(rollout)
    return twin.state_dict()


def test_the_target_never_changes_and_the_view_is_its_own() -> None:
    bonus = made()
    before = {name: value.clone() for name, value in bonus.network.target.state_dict().items()}
    for seed in range(3):
        bonus.update(around((seed, 1), seed=seed))
    for name, value in bonus.network.target.state_dict().items():
        assert_close(value, before[name], rtol=0, atol=0)
    assert int(bonus.network.view.count) == 3 * 64


def test_more_minibatches_than_steps_are_refused() -> None:
    with pytest.raises(ValueError, match=r"rnd_minibatches is 9; it must be at most num_envs \* rollout_length, 8"):
        RNDConfig(rnd_minibatches=9).check_rollout(8)


def test_observations_that_are_no_arrays_are_refused() -> None:
    with pytest.raises(ValueError, match="RND has no network for observations in Discrete"):
        RND(Setting(spaces.Discrete(3), spaces.Discrete(2), 1, 0, CPU), RNDConfig())
