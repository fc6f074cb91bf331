"""The log of episodes and the recorder on the environment: stamps, returns, resets, by hand and against a reference."""

from __future__ import annotations

import math
from fractions import Fraction
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.error import ResetNeeded
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from hypothesis import given, settings
from hypothesis import strategies as st

from sprl_bench import scores
from sprl_bench.recorder import EnvRecorder, EpisodeLog, VectorRecorder
from sprl_bench.recorder.wrappers import Listener

pytestmark = pytest.mark.usefixtures("fakes")

# What two sub-environments play: rewards, and whether by success. Then the last episode again and again.
SCRIPTS = (
    [([0.0, 1.0], True), ([0.0, 0.25, 0.25], False), ([0.0] * 50, False)],
    [([0.0, 0.0, 0.5], True), ([-1.0], False), ([0.0] * 50, False)],
)


class Count(Listener):
    """Counts how often the budget was reached."""

    def __init__(self) -> None:
        self.completions = 0

    def completed(self) -> None:
        self.completions += 1


def scripted(mode: AutoresetMode, budget: int = 100, listener: Listener | None = None) -> VectorRecorder:
    from harness_fakes import Scripted

    envs = SyncVectorEnv([lambda script=script: Scripted(script) for script in SCRIPTS], autoreset_mode=mode)
    return VectorRecorder(envs, budget, listener or Listener())


def rows(log: EpisodeLog) -> list[tuple[int, int, float, int, bool]]:
    return [tuple(row) for row in log.episodes.tolist()]


def step(envs: gymnasium.vector.VectorEnv[Any, Any, Any], times: int = 1) -> None:
    for _ in range(times):
        envs.step(np.zeros(envs.num_envs, np.int64))


def test_same_step_stamps_are_those_of_the_protocol() -> None:
    envs = scripted(AutoresetMode.SAME_STEP)
    envs.reset()
    step(envs, 5)
    # Ends at (t, i) = (2, 0), (3, 1), (4, 1), (5, 0) have stamps (t - 1) 2 + i + 1.
    assert rows(envs.episode_log) == [
        (3, 0, 1.0, 2, True),
        (6, 1, 0.5, 3, True),
        (8, 1, -1.0, 1, False),
        (9, 0, 0.5, 3, False),
    ]
    assert envs.episode_log.env_steps == 10


def test_steps_that_only_reset_are_not_counted() -> None:
    envs = scripted(AutoresetMode.NEXT_STEP)
    envs.reset()
    step(envs, 6)
    # t = 3 resets sub-environment 0, t = 4 and t = 6 reset 1: step numbers run 1 2 | 3 4 | - 5 | 6 - | 7 8 | 9 -.
    assert rows(envs.episode_log) == [
        (3, 0, 1.0, 2, True),
        (5, 1, 0.5, 3, True),
        (8, 1, -1.0, 1, False),
        (9, 0, 0.5, 3, False),
    ]
    assert envs.episode_log.env_steps == 9


def test_without_automatic_resets_masked_ones_begin_the_next_episode() -> None:
    envs = scripted(AutoresetMode.DISABLED)
    envs.reset()
    for _ in range(5):
        *_, terminated, truncated, _ = envs.step(np.zeros(2, np.int64))
        if (ended := terminated | truncated).any():
            envs.reset(options={"reset_mask": ended})
    assert rows(envs.episode_log) == [
        (3, 0, 1.0, 2, True),
        (6, 1, 0.5, 3, True),
        (8, 1, -1.0, 1, False),
        (9, 0, 0.5, 3, False),
    ]
    assert envs.episode_log.abandoned == 0


def test_a_masked_reset_takes_the_place_of_the_automatic_one() -> None:
    envs = scripted(AutoresetMode.NEXT_STEP)
    envs.reset()
    step(envs, 2)
    envs.reset(options={"reset_mask": np.array([True, False])})
    step(envs, 1)
    assert envs.episode_log.env_steps == 6


def test_the_curve_follows_from_the_stamps() -> None:
    envs = scripted(AutoresetMode.SAME_STEP)
    envs.reset()
    step(envs, 5)
    episodes = envs.episode_log.episodes
    curve = scores.curve(episodes["stamp"], episodes["return"], 100)
    assert curve[:10].tolist() == [0.0, 0.0, 1.0, 1.0, 1.0, 0.5, 0.5, -1.0, 0.5, 0.5]
    assert (curve[10:] == 0.5).all()


def test_what_is_reset_before_its_end_is_a_failure() -> None:
    envs = scripted(AutoresetMode.SAME_STEP)
    envs.reset()
    step(envs, 1)
    envs.reset(options={"reset_mask": np.array([False, True])})
    assert envs.episode_log.abandoned == 1
    step(envs, 2)
    assert rows(envs.episode_log) == [(2, 1, 0.0, 1, False), (3, 0, 1.0, 2, True), (4, 1, -1.0, 1, False)]
    envs.reset()
    envs.reset()
    assert envs.episode_log.abandoned == 3
    assert rows(envs.episode_log)[3:] == [(5, 0, 0.0, 1, False), (6, 1, 0.0, 1, False)]


def test_a_reset_after_the_budget_adds_nothing() -> None:
    envs = scripted(AutoresetMode.SAME_STEP, budget=2)
    envs.reset()
    step(envs, 1)
    envs.reset()
    assert (rows(envs.episode_log), envs.episode_log.abandoned) == ([], 0)


def test_a_shorter_time_limit_above_cannot_raise_a_score() -> None:
    from harness_fakes import Scripted

    log = EpisodeLog(0, 12, AutoresetMode.DISABLED)
    # It succeeds with its third step, then with its first, and then fails.
    script = [([0.0, 0.0, 1.0], True), ([1.0], True), ([0.0] * 50, False)]
    env = gymnasium.wrappers.TimeLimit(EnvRecorder(Scripted(script), log, log.add_env()), 2)
    env.reset()
    while not log.complete:
        *_, terminated, truncated, _ = env.step(0)
        if terminated or truncated:
            env.reset()
    assert [row[2:] for row in rows(log)] == [(0.0, 2, False), (1.0, 1, True), *[(0.0, 2, False)] * 4]


def test_nothing_beyond_the_budget_is_scored() -> None:
    listener = Count()
    envs = scripted(AutoresetMode.SAME_STEP, budget=7, listener=listener)
    envs.reset()
    step(envs, 3)
    assert not envs.episode_log.complete
    step(envs, 1)  # counts steps 7 and 8; the episode that ends with step 8 is out
    assert envs.episode_log.complete
    step(envs, 60)
    assert [row[0] for row in rows(envs.episode_log)] == [3, 6]
    assert listener.completions == 1
    assert envs.episode_log.env_steps == 8


def test_the_order_within_the_last_vector_step_decides() -> None:
    envs = scripted(AutoresetMode.SAME_STEP, budget=9)
    envs.reset()
    step(envs, 5)
    assert [row[0] for row in rows(envs.episode_log)] == [3, 6, 8, 9]


def test_what_happens_above_changes_no_score() -> None:
    from harness_fakes import Scripted

    plain = VectorRecorder(SyncVectorEnv([lambda: Scripted(SCRIPTS[0])], autoreset_mode=AutoresetMode.SAME_STEP), 100)
    plain.reset()
    step(plain, 10)
    above = VectorRecorder(SyncVectorEnv([lambda: Scripted(SCRIPTS[0])], autoreset_mode=AutoresetMode.SAME_STEP), 100)
    shaped = gymnasium.wrappers.vector.TransformReward(above, lambda reward: 100 * reward + 1)
    shaped.reset()
    for _ in range(10):
        _, rewards, terminated, truncated, infos = shaped.step(np.zeros(1, np.int64))
        rewards += 7
        terminated[:], truncated[:] = True, True
        infos.clear()
    assert rows(above.episode_log) == rows(plain.episode_log)


def test_a_single_environment_is_a_log_of_one() -> None:
    from harness_fakes import Scripted

    env = EnvRecorder(Scripted(SCRIPTS[0]), EpisodeLog(1, 100, AutoresetMode.DISABLED))
    env.reset()
    env.step(0)
    env.step(0)
    with pytest.raises(ResetNeeded, match="reset its environment"):
        env.step(0)
    env.reset()
    for _ in range(3):
        env.step(0)
    assert rows(env.episode_log) == [(2, 0, 1.0, 2, True), (5, 0, 0.5, 3, False)]


def test_success_is_read_from_the_step_that_ended_the_episode() -> None:
    """Under SameStep the infos of that call are already those of the next episode."""
    envs = scripted(AutoresetMode.SAME_STEP)
    envs.reset()
    step(envs, 1)
    *_, infos = envs.step(np.zeros(2, np.int64))
    assert not infos["is_success"].any()
    assert rows(envs.episode_log)[0][4]


def test_environments_that_do_not_report_success_have_none() -> None:
    envs = VectorRecorder(
        gymnasium.make_vec("CartPole-v1", 2, "sync", {"autoreset_mode": AutoresetMode.SAME_STEP}), 1000
    )
    envs.reset(seed=0)
    step(envs, 30)
    assert len(envs.episode_log.episodes) > 2
    assert not envs.episode_log.episodes["success"].any()


def test_rewards_that_are_not_finite_are_refused() -> None:
    log = EpisodeLog(1, 100)
    with pytest.raises(ValueError, match="finite"):
        log.step(np.array([math.nan]), np.array([True]), np.array([False]))


def test_what_rounding_took_is_part_of_the_state() -> None:
    log, later = EpisodeLog(1, 10**6), EpisodeLog(1, 10**6)
    for reward in (1e16, 1.0, 1.0):
        log.step(np.array([reward]), np.array([False]), np.array([False]))
    later.load_state_dict(log.state_dict())
    later.step(np.array([-1e16]), np.array([True]), np.array([False]))
    assert later.episodes["return"].tolist() == [2.0]


def test_returns_lose_nothing_to_rounding() -> None:
    log, rewards = EpisodeLog(1, 10**6), [1e16, 1.0, 1.0, 1.0, -1e16, 0.1, 0.2]
    for index, reward in enumerate(rewards):
        log.step(np.array([reward]), np.array([index == len(rewards) - 1]), np.array([False]))
    log.step(np.array([0.5]), np.array([True]), np.array([False]))
    assert log.episodes["return"].tolist() == [math.fsum(rewards), 0.5]
    assert log.episodes["return"][0] != sum(rewards)


Steps = list[tuple[list[float], list[bool], list[bool], list[bool]]]

QUARTERS = st.integers(-8, 8).map(lambda number: number / 4)  # their sums are exact


@st.composite
def streams(draw: st.DrawFn) -> tuple[int, Steps]:
    """Draw N and a stream of (rewards, ended, success, reset before the step)."""
    envs = draw(st.integers(1, 4))

    def row(values: st.SearchStrategy[Any]) -> st.SearchStrategy[list[Any]]:
        return st.lists(values, min_size=envs, max_size=envs)

    rare = st.sampled_from([False, False, False, True])
    return envs, draw(st.lists(st.tuples(row(QUARTERS), row(rare), row(st.booleans()), row(rare)), max_size=40))


class Reference:
    """One sub-environment, in plain Python."""

    def __init__(self, index: int, mode: AutoresetMode) -> None:
        self.index, self.mode = index, mode
        self.rewards: list[Fraction] = []
        self.over, self.stamp = False, 0

    def reset(self) -> list[tuple[int, int, float, int, bool]]:
        rows = [(self.stamp, self.index, float(sum(self.rewards)), len(self.rewards), False)] if self.rewards else []
        self.rewards, self.over = [], False
        return rows

    def step(self, reward: float, ended: bool, success: bool, stamp: int) -> list[tuple[int, int, float, int, bool]]:
        self.rewards.append(Fraction(reward))
        self.stamp = stamp
        if not ended:
            return []
        row = (stamp, self.index, float(sum(self.rewards)), len(self.rewards), success)
        self.rewards, self.over = [], self.mode is not AutoresetMode.SAME_STEP
        return [row]


def reference(envs: int, stream: Steps, mode: AutoresetMode, budget: int) -> list[tuple[int, int, float, int, bool]]:
    singles, stamp, found = [Reference(index, mode) for index in range(envs)], 0, []
    for rewards, ended, success, reset in stream:
        for single, wanted in zip(singles, reset, strict=True):
            if wanted or (single.over and mode is AutoresetMode.DISABLED):
                abandoned = single.reset()
                found += abandoned if stamp < budget else []
        for single, *what in zip(singles, rewards, ended, success, strict=True):
            if single.over:
                single.reset()
            else:
                stamp += 1
                found += single.step(*what, stamp)
    return sorted(row for row in found if row[0] <= budget)


def feed(log: EpisodeLog, stream: Steps) -> None:
    """Feed a log as the recorder would; what must be reset from outside is."""
    for rewards, ended, success, reset in stream:
        mask = np.array(reset)
        if log.autoreset is AutoresetMode.DISABLED:
            mask |= log._over
        log.reset(mask)
        log.step(np.array(rewards), np.array(ended), np.array(success))


@settings(deadline=None, max_examples=60)
@given(streams(), st.sampled_from(AutoresetMode), st.integers(1, 120))
def test_the_log_equals_a_plain_reference(drawn: tuple[int, Steps], mode: AutoresetMode, budget: int) -> None:
    log = EpisodeLog(drawn[0], budget, mode)
    feed(log, drawn[1])
    assert rows(log) == reference(*drawn, mode, budget)


@settings(deadline=None, max_examples=60)
@given(streams(), st.sampled_from(AutoresetMode), st.data())
def test_a_log_goes_on_from_its_state(drawn: tuple[int, Steps], mode: AutoresetMode, data: st.DataObject) -> None:
    cut = data.draw(st.integers(0, len(drawn[1])))
    whole, first, second = (EpisodeLog(drawn[0], 100, mode) for _ in range(3))
    feed(whole, drawn[1])
    feed(first, drawn[1][:cut])
    state = first.state_dict()
    feed(first, drawn[1][cut:])  # the state is a copy
    second.load_state_dict(state)
    feed(second, drawn[1][cut:])
    assert rows(second) == rows(whole) == rows(first)
    assert (second.env_steps, second.abandoned) == (whole.env_steps, whole.abandoned)


def test_the_state_holds_what_is_under_way() -> None:
    first, second = (EpisodeLog(2, 100, AutoresetMode.NEXT_STEP) for _ in range(2))
    calls = [([0.5, 0.5], [False, True]), ([1.0, 0.0], [False, False]), ([1.0, 1.0], [True, True])]
    for rewards, ended in calls[:1]:
        first.step(np.array(rewards), np.array(ended), np.array([False, False]))
    state = first.state_dict()
    for rewards, ended in calls[1:]:
        first.step(np.array(rewards), np.array(ended), np.array([False, False]))
    second.load_state_dict(state)
    for rewards, ended in calls[1:]:
        second.step(np.array(rewards), np.array(ended), np.array([False, False]))
    assert rows(first) == rows(second) == [(2, 1, 0.5, 1, False), (4, 0, 2.5, 3, False), (5, 1, 1.0, 1, False)]


def test_the_log_grows_beyond_its_first_rows() -> None:
    log = EpisodeLog(1, 10**6)
    for index in range(5000):
        log.step(np.array([float(index)]), np.array([True]), np.array([False]))
    assert log.episodes["return"].tolist() == list(range(5000))


def test_a_state_of_another_size_is_refused() -> None:
    with pytest.raises(ValueError, match="of 2 sub-environments; this log has 3"):
        EpisodeLog(3, 10).load_state_dict(EpisodeLog(2, 10).state_dict())


def test_single_environments_of_one_log_are_counted_in_the_order_of_their_steps() -> None:
    from harness_fakes import Scripted

    log = EpisodeLog(0, 100, AutoresetMode.DISABLED)
    singles = [EnvRecorder(Scripted(script), log, log.add_env()) for script in SCRIPTS]
    for single in singles:
        single.reset()
    for _ in range(5):
        for single in singles:
            *_, terminated, truncated, _ = single.step(0)
            if terminated or truncated:
                single.reset()
    assert [row[:2] for row in rows(log)] == [(3, 0), (6, 1), (8, 1), (9, 0)]


@pytest.mark.parametrize(
    ("name", "value"), [("env_steps", 2**40), ("env_steps", -1), ("env", 2), ("env", -1), ("stamp", 10**6)]
)
def test_a_state_that_no_log_can_have_is_refused(name: str, value: int) -> None:
    log = EpisodeLog(2, 100)
    log.load_state_dict(EpisodeLog(2, 100).state_dict())
    state = EpisodeLog(2, 100).state_dict()
    state["env_steps"] = 10
    state["episodes"] = {
        "stamp": np.array([4]),
        "env": np.array([1]),
        "return": np.array([1.0]),
        "length": np.array([2]),
        "success": np.array([True]),
    }
    log.load_state_dict(state)
    before = log.state_dict()
    part = state if name == "env_steps" else state["episodes"]
    part[name] = value if name == "env_steps" else np.array([value])
    with pytest.raises(ValueError, match=f"{name} is outside of 0 to"):
        log.load_state_dict(state)
    assert log.env_steps == before["env_steps"] == 10
