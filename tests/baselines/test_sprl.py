"""SPRL's cost: hand-made walks with the ground truth, and any walk against a slow and plain implementation."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import gymnasium
import numpy as np
import pytest
import torch
from gymnasium import spaces
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor

import sprl_bench  # noqa: F401 - registers the ids
from sprl_baselines.agents import gt_sprl, sprl
from sprl_baselines.bonus import Setting
from sprl_baselines.learning.collector import Collector, Decision
from sprl_baselines.learning.rollout import Rollout
from sprl_baselines.sprl import SPRL, ConstraintConfig, SPRLConfig, count_votes, votes_needed
from sprl_bench import solver

CPU = torch.device("cpu")
LEFT, RIGHT, FORWARD, DONE = 0, 1, 2, 6
EARLY, PAID = 0.25, -0.75  # what a step gets without and with a cost, at bias 0.25 and scale 1


# -------------------------------------------------------------------------------------------- votes


@pytest.mark.parametrize(("samples", "needed"), [(1, 1), (20, 3), (60, 7), (200, 21)])
def test_as_many_votes_as_the_90th_percentile_asks_for(samples: int, needed: int) -> None:
    assert votes_needed(samples, 0.9) == needed


@given(st.integers(1, 200), st.sampled_from([0.0, 0.5, 0.9, 1.0]), st.data())
def test_votes_decide_as_the_nearest_rank_percentile(samples: int, quantile: float, data: Any) -> None:
    yes = data.draw(st.integers(0, samples))
    answers = np.array([1.0] * yes + [0.0] * (samples - yes))
    # NumPy's "nearest" rounds half to even, as Python does.
    assert (yes >= votes_needed(samples, quantile)) == (np.percentile(answers, 100 * quantile, method="nearest") > 0.5)


@given(
    runs=st.lists(st.integers(0, 40), min_size=1, max_size=8),
    samples=st.integers(1, 30),
    tolerance=st.integers(1, 3),
    threshold=st.sampled_from([0.3, 0.5, 0.75]),
    needed=st.integers(1, 5),
    seed=st.integers(0, 99),
)
def test_votes_are_counted_as_far_as_the_verdict_needs(
    runs: list[int], samples: int, tolerance: int, threshold: float, needed: int, seed: int
) -> None:
    answers = np.random.default_rng(seed).random((len(runs), 200)).astype(np.float32)  # by state and length
    reached = answers > threshold
    lengths, stride = 2 + tolerance * torch.arange(1, samples + 1), 500
    ends = 10**6 + torch.arange(len(runs))

    def judge(earlier: Tensor, later: Tensor) -> Tensor:
        rows, steps = (later - 10**6).numpy(), ((later - earlier) // stride).numpy()
        return torch.from_numpy(answers[rows, steps])

    votes = count_votes(judge, ends, torch.tensor(runs), lengths, stride=stride, threshold=threshold, needed=needed)
    for row, run in enumerate(runs):
        truth = sum(bool(reached[row, length]) for length in lengths.tolist() if length <= run)
        assert (votes[row] >= needed) == (truth >= needed)
        assert votes[row] <= truth


# --------------------------------------------------------------------------- a line and a made-up judge

LINE = spaces.Box(-1e6, 1e6, (1,), np.float32)


class Constant:
    """Every state leads to every other with one probability."""

    ready, privileged = True, False

    def __init__(self, likely: float) -> None:
        self._likely = likely

    def judge_of(self, states: Tensor) -> Any:
        return lambda earlier, later: torch.full(earlier.shape, self._likely)

    def update(self, rollout: Rollout) -> dict[str, float]:
        return {}


def on_a_line(likely: float, bias: float, **settings: float) -> SPRL:
    config = ConstraintConfig.pick({"k": 2, "tolerance_samples": 1, "cost_scale": 1.0, "bias": bias, **settings})
    return SPRL(Setting(LINE, spaces.Discrete(2), 1, seed=0, device=CPU), config, Constant(likely))  # type: ignore[arg-type]


def line_rollout(steps: int, **changes: Tensor) -> Rollout:
    states, nothing = torch.arange(steps + 1.0).view(-1, 1, 1), torch.zeros(steps, 1, dtype=torch.bool)
    rollout = Rollout(
        observations=states[:-1],
        actions=torch.zeros(steps, 1),
        rewards=torch.zeros(steps, 1),
        terminated=nothing,
        truncated=nothing,
        values=torch.zeros(steps, 1),
        log_probs=torch.zeros(steps, 1),
        last_observations=states[-1],
        final_observations=torch.zeros(0, 1),
        positions=torch.zeros(steps, 1, 0),
        next_positions=torch.zeros(steps, 1, 0),
    )
    return replace(rollout, **changes)


@pytest.mark.parametrize(("cost_per", "scale"), [("action", 1.0), ("reference-action", 0.15)])
def test_the_cost_may_be_per_simulated_time(cost_per: str, scale: float) -> None:
    config = ConstraintConfig(k=2, tolerance_samples=1, cost_scale=1.0, bias=0.25, cost_per=cost_per)
    setting = Setting(LINE, spaces.Discrete(2), 1, seed=0, device=CPU, action_time=0.15)
    bonus = SPRL(setting, config, Constant(0.6))  # type: ignore[arg-type]
    expected = torch.tensor([EARLY, EARLY, PAID, PAID]) * scale
    torch.testing.assert_close(bonus.reward(line_rollout(4)).squeeze(1), expected)


@pytest.mark.parametrize(("likely", "expected"), [(0.4, EARLY), (0.6, PAID)])
def test_more_than_a_half_is_a_yes(likely: float, expected: float) -> None:
    bonus = on_a_line(likely, bias=0.25)
    rollout = line_rollout(4)
    assert bonus.reward(rollout).squeeze(1).tolist() == [EARLY, EARLY, expected, expected]
    assert bonus.update(rollout) == {"violations": 0.5 * (expected == PAID)}


@pytest.mark.parametrize(("likely", "expected"), [(0.6, EARLY), (0.75, EARLY), (0.8, PAID)])
def test_what_an_answer_must_exceed_can_be_set(likely: float, expected: float) -> None:
    bonus = on_a_line(likely, bias=0.25, vote_threshold=0.75)
    assert bonus.reward(line_rollout(4)).squeeze(1).tolist() == [EARLY, EARLY, expected, expected]


@pytest.mark.parametrize(
    ("field", "sign"), [("terminated", 1.0), ("truncated", 1.0), ("rewards", 1.0), ("rewards", -1.0)]
)
def test_nothing_is_compared_across_an_ending_or_a_reward_of_either_sign(field: str, sign: float) -> None:
    """Where a map is new in each episode nothing could be reached anyway; a network might say otherwise."""
    at = torch.zeros(8, 1)
    at[4] = sign
    change = at if field == "rewards" else at.bool()
    charged = -on_a_line(1.0, bias=0.0).reward(line_rollout(8, **{field: change}))
    assert charged.squeeze(1).tolist() == [0, 0, 1, 1, 0, 0, 0, 1]


# ---------------------------------------------------------------------------------- hand-made walks


class Walks:
    """Rollouts of hand-chosen actions in one sub-env of an empty corner, and what they are charged."""

    def __init__(self, **settings: Any) -> None:
        self.envs: Any = gymnasium.make_vec("SPRL/FourRooms-11x11-v1", num_envs=1, num_threads=1)
        self.envs.reset(seed=3)
        self.collector = Collector(self.envs, 1, CPU)
        self.collector.reset()
        config = ConstraintConfig(**{"k": 2, "tolerance_samples": 1, "cost_scale": 1.0, "bias": 0.25, **settings})
        self.bonus = SPRL.true(self.setting, config)

    @property
    def setting(self) -> Setting:
        return Setting(self.envs.single_observation_space, self.envs.single_action_space, 1, seed=0, device=CPU)

    def take(self, *actions: int) -> list[float]:
        """Take actions one by one, each a rollout of its own, and return what each got."""
        return [float(self.bonus.reward(self.step(action))) for action in actions]

    def step(self, action: int) -> Rollout:
        decision = Decision(torch.tensor([action]), torch.zeros(1), torch.zeros(1))
        return self.collector.collect(lambda _: decision)


def test_turning_one_way_is_charged_once_it_comes_back_the_long_way() -> None:
    """Three right turns are one left turn: with k = 2 and one length, 3, the third step of a turn is a violation."""
    assert Walks().take(RIGHT, RIGHT, RIGHT, RIGHT) == [EARLY, EARLY, PAID, PAID]


def test_standing_still_is_charged() -> None:
    assert Walks().take(DONE, DONE, DONE, DONE) == [EARLY, EARLY, PAID, PAID]


def test_back_and_forth_is_charged() -> None:
    assert Walks().take(LEFT, RIGHT, LEFT, RIGHT) == [EARLY, EARLY, PAID, PAID]


@pytest.mark.parametrize("samples", [1, 20])
def test_a_shortest_path_to_the_goal_is_free(samples: int) -> None:
    walks = Walks(tolerance_samples=samples)
    path = solver.shortest_path(walks.collector.state_dict()["observations"][0]).tolist()
    assert len(path) > 5
    assert walks.take(*path) == [EARLY] * len(path)


def test_a_walk_shorter_than_the_stretch_is_free() -> None:
    assert Walks(k=5).take(*[DONE] * 5) == [EARLY] * 5


def test_votes_of_several_lengths_are_needed() -> None:
    """Twenty lengths, 3 to 22: three of them must have room, so nothing is charged before step 5."""
    assert Walks(tolerance_samples=20).take(*[DONE] * 6) == [EARLY] * 4 + [PAID] * 2


def test_the_time_limit_ends_a_stretch_and_is_not_charged_itself() -> None:
    rewards = Walks().take(*[DONE] * 104)
    assert rewards == [EARLY, EARLY] + [PAID] * 97 + [EARLY] + [EARLY, EARLY] + [PAID] * 2


def test_a_reward_ends_a_stretch_and_is_not_charged_itself() -> None:
    walks = Walks()
    rollouts = [walks.step(DONE) for _ in range(9)]
    object.__setattr__(rollouts[4], "rewards", torch.ones(1, 1))
    got = [float(walks.bonus.reward(rollout)) for rollout in rollouts]
    assert got == [EARLY, EARLY, PAID, PAID, EARLY, EARLY, EARLY, PAID, PAID]


# ------------------------------------------------------------------------- any walk, plainly and slowly


def plain_costs(stream: list[Rollout], config: ConstraintConfig) -> np.ndarray:
    """Follow the definition step by step, over a whole stream of rollouts."""
    costs = []
    num_envs = stream[0].rewards.shape[1]
    pasts: list[list[np.ndarray]] = [[] for _ in range(num_envs)]
    for rollout in stream:
        following = rollout.next_observations.numpy()
        for step in range(len(rollout.rewards)):
            row = np.zeros(num_envs)
            for env in range(num_envs):
                past = pasts[env]
                past.append(rollout.observations[step, env].numpy())
                if rollout.ended[step, env] or rollout.rewards[step, env] != 0:
                    past.clear()
                    continue
                votes = [0.0] * config.tolerance_samples
                for index in range(config.tolerance_samples):
                    length = config.k + (index + 1) * config.tolerance
                    if len(past) >= length:
                        pair = past[-length][None], following[step, env][None]
                        votes[index] = float(solver.reachable(*pair, config.k)[0])
                quantile = 100 * config.vote_quantile
                row[env] = np.percentile(votes, quantile, method="nearest") > 0.5
            costs.append(row)
    return np.array(costs)


@settings(max_examples=25)
@given(
    env_id=st.sampled_from(["SPRL/FourRooms-7x7-v1", "SPRL/KeyDoors-7x7-v1"]),
    k=st.integers(1, 4),
    tolerance=st.integers(1, 3),
    samples=st.integers(1, 25),
    lengths=st.lists(st.integers(1, 40), min_size=1, max_size=3),
    seed=st.integers(0, 1000),
)
def test_the_cost_is_that_of_the_definition(
    env_id: str, k: int, tolerance: int, samples: int, lengths: list[int], seed: int
) -> None:
    envs: Any = gymnasium.make_vec(env_id, num_envs=3, num_threads=1, max_episode_steps=30)
    envs.reset(seed=seed)
    rng = np.random.default_rng(seed)
    config = ConstraintConfig(k=k, tolerance=tolerance, tolerance_samples=samples, cost_scale=1.0, bias=0.0)
    setting = Setting(envs.single_observation_space, envs.single_action_space, 3, seed=0, device=CPU)
    bonus = SPRL.true(setting, config)

    def act(observations: Tensor) -> Decision:
        """Wander, and now and then walk to the goal, so that there are rewards."""
        best = solver.optimal_actions(observations.numpy())
        drawn = np.where(rng.random(3) < 0.3, best, rng.integers(7, size=3))
        return Decision(torch.from_numpy(drawn), torch.zeros(3), torch.zeros(3))

    start = Collector(envs, 1, CPU)
    start.reset()
    stream, charged, state = [], [], start.state_dict()
    for length in lengths:
        collector = Collector(envs, length, CPU)
        collector.load_state_dict(state)
        stream.append(collector.collect(act))
        charged.append(-bonus.reward(stream[-1]).numpy())
        state = collector.state_dict()
    assert np.array_equal(np.concatenate(charged), plain_costs(stream, config))


# --------------------------------------------------------------------------------------- the agents


def test_nothing_is_paid_until_the_network_is_ready_and_the_memory_goes_on_meanwhile() -> None:
    walks = Walks()
    bonus = SPRL.learned(walks.setting, SPRLConfig(tolerance_samples=1, cost_scale=1.0, bias=0.25))
    assert [float(bonus.reward(walks.step(DONE))) for _ in range(5)] == [0.0] * 5
    bonus.reachability = walks.bonus.reachability
    assert float(bonus.reward(walks.step(DONE))) == PAID


def test_the_ground_truth_has_no_network_to_set() -> None:
    with pytest.raises(ValueError, match="Unknown hyperparameter 'replay_size'"):
        gt_sprl(seed=0, replay_size=10)
    assert gt_sprl.privileged
    assert not sprl.privileged


def test_continuous_observations_are_judged_too() -> None:
    box = spaces.Box(-1, 1, (4,), np.float64)
    bonus = SPRL.learned(Setting(box, box, 2, seed=0, device=CPU), SPRLConfig(k=3, tolerance_samples=5, replay_size=64))
    bonus.reachability._ready = True  # type: ignore[attr-defined]
    nothing = torch.zeros(20, 2, dtype=torch.bool)
    states = torch.rand(21, 2, 4, dtype=torch.float64, generator=torch.Generator().manual_seed(0))
    rollout = Rollout(
        observations=states[:-1], actions=torch.zeros(20, 2, 4), rewards=torch.zeros(20, 2), terminated=nothing,
        truncated=nothing, values=torch.zeros(20, 2), log_probs=torch.zeros(20, 2), last_observations=states[-1],
        final_observations=states[:0, 0], positions=torch.zeros(20, 2, 0), next_positions=torch.zeros(20, 2, 0),
    )  # fmt: skip
    assert bonus.reward(rollout).shape == (20, 2)
