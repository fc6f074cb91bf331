"""The collector, against an environment whose every step is written down beforehand."""

from __future__ import annotations

import itertools
from typing import Any

import gymnasium
import numpy as np
import pytest
import torch
from gymnasium import spaces
from gymnasium.vector import AutoresetMode, SyncVectorEnv

import sprl_bench  # noqa: F401 - registers the ids
from sprl_baselines.learning.collector import Collector, Decision, stacked

CPU = torch.device("cpu")


class Scripted(gymnasium.Env[Any, Any]):
    """Shows 100 * episode + step; its episodes end by turns after the lengths and in the ways of its script."""

    observation_space = spaces.Box(-1, 1e6, (1,), np.float32)

    def __init__(self, script: list[tuple[int, str]], action_space: spaces.Space[Any] | None = None) -> None:
        self.action_space = action_space or spaces.Discrete(2)
        self._script, self._episode, self.received = script, -1, []

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        super().reset(seed=seed)
        self._episode, self._step = self._episode + 1, 0
        return self._show()

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        self.received.append(action)
        self._step += 1
        length, how = self._script[self._episode % len(self._script)]
        over = self._step == length
        observation, info = self._show()
        return observation, float(self._step), over and "terminated" in how, over and "truncated" in how, info

    def _show(self) -> tuple[Any, dict[str, Any]]:
        return np.float32([100 * self._episode + self._step]), {"position": np.array([self._episode, self._step])}


def vector(*scripts: list[tuple[int, str]], **arguments: Any) -> SyncVectorEnv:
    makers = [lambda script=script: Scripted(script, **arguments) for script in scripts]
    return SyncVectorEnv(makers, autoreset_mode=AutoresetMode.SAME_STEP)


def numbered_policy() -> Any:
    """Return a policy whose k-th decision is action k % 2, log-probability -k, value k."""
    count = iter(range(10**6))

    def act(observations: torch.Tensor) -> Decision:
        k = next(count)
        row = torch.full((len(observations),), float(k))
        return Decision((row % 2).long(), -row, row)

    return act


SCRIPTS = [(3, "terminated"), (2, "truncated")], [(4, "truncated and terminated"), (50, "truncated")]


def collector(length: int = 6) -> Collector:
    made = Collector(vector(*SCRIPTS), length, CPU)
    made.reset()
    return made


def test_what_was_seen_done_and_given() -> None:
    rollout = collector().collect(numbered_policy())
    assert rollout.observations.squeeze(-1).T.tolist() == [[0, 1, 2, 100, 101, 200], [0, 1, 2, 3, 100, 101]]
    assert rollout.rewards.T.tolist() == [[1, 2, 3, 1, 2, 1], [1, 2, 3, 4, 1, 2]]
    assert rollout.rewards.dtype == torch.float32
    assert rollout.actions.tolist() == [[0, 0], [1, 1], [0, 0], [1, 1], [0, 0], [1, 1]]
    assert rollout.values[:, 0].tolist() == [0, 1, 2, 3, 4, 5]
    assert rollout.log_probs[:, 1].tolist() == [0, -1, -2, -3, -4, -5]
    assert rollout.num_steps == 12


def test_the_two_endings_stay_apart() -> None:
    rollout = collector().collect(numbered_policy())
    assert rollout.terminated.nonzero().tolist() == [[2, 0], [3, 1]]
    assert rollout.truncated.nonzero().tolist() == [[3, 1], [4, 0]]
    assert rollout.ended.nonzero().tolist() == [[2, 0], [3, 1], [4, 0]]


def test_successors_are_the_true_ones() -> None:
    rollout = collector().collect(numbered_policy())
    assert rollout.final_observations.squeeze(-1).tolist() == [3, 4, 102]
    assert rollout.next_observations.squeeze(-1).T.tolist() == [[1, 2, 3, 101, 102, 201], [1, 2, 3, 4, 101, 102]]
    assert rollout.last_observations.squeeze(-1).tolist() == [201, 102]


def test_positions_go_with_observations() -> None:
    rollout = collector().collect(numbered_policy())
    for places, observations in (
        (rollout.positions, rollout.observations),
        (rollout.next_positions, rollout.next_observations),
    ):
        assert torch.equal(100 * places[..., 0] + places[..., 1], observations.squeeze(-1).long())


def test_rollouts_join_without_a_seam() -> None:
    whole = collector(12).collect(numbered_policy())
    in_parts, policy = collector(4), numbered_policy()
    parts = [in_parts.collect(policy) for _ in range(3)]
    for name in ("observations", "actions", "rewards", "terminated", "truncated", "values", "next_observations"):
        assert torch.equal(torch.cat([getattr(part, name) for part in parts]), getattr(whole, name)), name
    for earlier, later in itertools.pairwise(parts):
        assert torch.equal(earlier.last_observations, later.observations[0])


def test_a_rollout_without_endings_and_one_of_nothing_else() -> None:
    calm = Collector(vector([(50, "truncated")]), 5, CPU)
    calm.reset()
    rollout = calm.collect(numbered_policy())
    assert rollout.final_observations.shape == (0, 1)
    assert rollout.next_observations.squeeze(-1).T.tolist() == [[1, 2, 3, 4, 5]]
    busy = Collector(vector([(1, "terminated")]), 3, CPU)
    busy.reset()
    assert busy.collect(numbered_policy()).next_observations.squeeze(-1).T.tolist() == [[1, 101, 201]]


def test_grids_report_positions_of_the_agent() -> None:
    envs = gymnasium.make_vec("SPRL/FourRooms-7x7-v1", num_envs=3)
    envs.reset(seed=5)
    made = Collector(envs, 120, CPU)
    made.reset()
    generator = torch.Generator().manual_seed(0)

    def act(observations: torch.Tensor) -> Decision:
        zeros = torch.zeros(len(observations))
        return Decision(torch.randint(3, (len(observations),), generator=generator), zeros, zeros)

    rollout = made.collect(act)
    assert rollout.ended.any()
    agent = 10  # Minigrid's code of the agent
    for places, grids in (
        (rollout.positions, rollout.observations),
        (rollout.next_positions, rollout.next_observations),
    ):
        found = (grids[..., 0] == agent).nonzero()  # rows of (t, n, y, x)
        assert torch.equal(found[:, [3, 2]].view(places.shape), places)


def test_envs_that_reuse_their_arrays_are_copied() -> None:
    rollouts = []
    for copy in (True, False):
        envs = gymnasium.make_vec("SPRL/FourRooms-7x7-v1", num_envs=3, copy=copy)
        envs.reset(seed=5)
        made = Collector(envs, 30, CPU)
        made.reset()
        rollouts.append(made.collect(numbered_policy()))
    for name in ("observations", "positions", "rewards", "last_observations"):
        assert torch.equal(*(getattr(rollout, name) for rollout in rollouts)), name


def test_envs_without_positions_give_none() -> None:
    envs = SyncVectorEnv([lambda: gymnasium.make("CartPole-v1")] * 2, autoreset_mode=AutoresetMode.SAME_STEP)
    envs.reset(seed=0)
    made = Collector(envs, 60, CPU)
    made.reset()
    rollout = made.collect(numbered_policy())
    assert rollout.positions.shape == rollout.next_positions.shape == (60, 2, 0)


def test_continuous_actions_are_kept_as_drawn_and_executed_clipped() -> None:
    envs = vector([(50, "truncated")], action_space=spaces.Box(-1, 1, (2,), np.float32))
    made = Collector(envs, 1, CPU)
    made.reset()
    drawn = torch.tensor([[0.5, -3.0]])
    rollout = made.collect(lambda _: Decision(drawn, torch.zeros(1), torch.zeros(1)))
    assert torch.equal(rollout.actions[0], drawn)
    assert envs.envs[0].unwrapped.received[0].tolist() == [0.5, -1.0]


def noisy(seed: int, noise: float = 0.25) -> tuple[Collector, Any]:
    envs = vector([(500, "truncated")], action_space=spaces.Box(-1, 1, (2,), np.float32))
    made = Collector(envs, 100, CPU, action_noise=noise, seed=seed)
    made.reset()
    return made, envs.envs[0].unwrapped


def held_still(observations: torch.Tensor) -> Decision:
    return Decision(torch.zeros(1, 2), torch.zeros(1), torch.zeros(1))


def test_action_noise_reaches_the_env_but_not_the_rollout() -> None:
    made, env = noisy(seed=0)
    rollout = made.collect(held_still)
    assert not rollout.actions.any()
    assert np.std(env.received) == pytest.approx(0.25, rel=0.15)


def test_what_noise_makes_too_large_is_clipped() -> None:
    made, env = noisy(seed=0, noise=5.0)
    made.collect(held_still)
    assert (np.min(env.received), np.max(env.received)) == (-1.0, 1.0)


def test_action_noise_is_a_function_of_its_seed_and_goes_on_where_it_was_saved() -> None:
    (first, ours), (second, theirs), (other, others) = noisy(seed=3), noisy(seed=3), noisy(seed=4)
    for made in (first, second, other):
        made.collect(held_still)
    assert np.array_equal(ours.received, theirs.received)
    assert not np.array_equal(ours.received, others.received)
    other.load_state_dict(first.state_dict())
    for made in (first, other):
        made.collect(held_still)
    assert np.array_equal(ours.received[100:], others.received[100:])


def test_action_noise_is_refused_where_actions_are_not_continuous() -> None:
    with pytest.raises(ValueError, match=r"action_noise is 0.1; it must be 0 for actions in Discrete\(2\)"):
        Collector(vector(*SCRIPTS), 4, CPU, action_noise=0.1)


def test_earlier_observations_of_the_same_episode_are_joined_oldest_first() -> None:
    made = Collector(vector(*SCRIPTS), 6, CPU, stack=2)
    made.reset()
    seen: list[list[list[float]]] = []

    def act(observations: torch.Tensor) -> Decision:
        seen.append(observations.tolist())
        return Decision(torch.zeros(2, dtype=torch.int64), torch.zeros(2), torch.zeros(2))

    rollout = made.collect(act)
    assert rollout.observations[:, 0].tolist() == [
        [0, 0, 0],
        [0, 0, 1],
        [0, 1, 2],
        [100, 100, 100],
        [100, 100, 101],
        [200, 200, 200],
    ]
    assert rollout.final_observations.tolist() == [[1, 2, 3], [2, 3, 4], [100, 101, 102]]
    assert rollout.last_observations.tolist() == [[200, 200, 201], [100, 101, 102]]
    assert rollout.observations.tolist() == seen
    alone, plain = rollout.newest(2), collector().collect(numbered_policy())
    for name in ("observations", "last_observations", "final_observations", "next_observations"):
        assert torch.equal(getattr(alone, name), getattr(plain, name)), name
    assert plain.newest(0) is plain


def test_joined_observations_have_a_space_of_their_own() -> None:
    space = spaces.Box(np.float32([-1, 0]), np.float32([1, 5]))
    assert stacked(space, 0) is space
    assert stacked(space, 1) == spaces.Box(np.float32([-1, 0, -1, 0]), np.float32([1, 5, 1, 5]))
    assert stacked(spaces.Box(0, 255, (7, 7, 3), np.uint8), 4) == spaces.Box(0, 255, (7, 7, 15), np.uint8)
    with pytest.raises(ValueError, match=r"stack is 1; it must be 0 for observations in Discrete\(3\)"):
        stacked(spaces.Discrete(3), 1)


@pytest.mark.parametrize("mode", ["NextStep", "Disabled"])
def test_other_ways_to_reset_are_refused(mode: str) -> None:
    envs = gymnasium.make_vec("SPRL/FourRooms-7x7-v1", num_envs=2, autoreset_mode=mode)
    with pytest.raises(ValueError, match=r"autoreset_mode of the vector env is .*; it must be .*SAME_STEP"):
        Collector(envs, 4, CPU)


def test_the_envs_are_reset_without_a_seed() -> None:
    envs = gymnasium.make_vec("SPRL/FourRooms-7x7-v1", num_envs=2)
    expected = gymnasium.make_vec("SPRL/FourRooms-7x7-v1", num_envs=2)
    for one in (envs, expected):
        one.reset(seed=3)
    made = Collector(envs, 1, CPU)
    made.reset()
    assert np.array_equal(made.state_dict()["observations"], expected.reset()[0])
