"""The engines as vector environments of Stable-Baselines3: equal to its own, recorded or not, under its wrappers."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import SyncVectorEnv

import sprl_bench
from sprl_bench.envs.vector import BatchedEnv
from sprl_bench.recorder import VectorRecorder
from sprl_bench.records import find_records
from sprl_bench.run import run
from sprl_bench.suite import expand
from sprl_bench.tasks import find_suite

pytest.importorskip("stable_baselines3")
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import EvalCallback
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.vec_env import DummyVecEnv, VecMonitor, VecNormalize

from sprl_bench.sb3 import as_vec_env

ROOMS, REACH = "SPRL/FourRooms-7x7-v1", "SPRL/FetchReachSparse-v1"


def assert_equal(ours: Any, theirs: Any, where: str = "") -> None:
    if isinstance(theirs, dict):
        assert ours.keys() == theirs.keys(), where
        for name, value in theirs.items():
            assert_equal(ours[name], value, f"{where} {name}")
    else:
        assert np.asarray(ours).dtype == np.asarray(theirs).dtype, where
        assert np.array_equal(ours, theirs), where


@pytest.mark.parametrize(
    ("env_id", "arguments"),
    [
        (ROOMS, {"max_episode_steps": 9}),
        (ROOMS, {"observation": "flat"}),
        (REACH, {"substep": 20}),
        (REACH, {"observation": "goal", "max_episode_steps": 7}),
    ],
)
def test_it_equals_their_vector_environment_of_single_ones(env_id: str, arguments: dict[str, Any]) -> None:
    ours = as_vec_env(gymnasium.make_vec(env_id, num_envs=3, **arguments), infos="all")
    theirs = DummyVecEnv([lambda: gymnasium.make(env_id, **arguments)] * 3)
    assert (ours.observation_space, ours.action_space) == (theirs.observation_space, theirs.action_space)
    assert ours.seed(5) == theirs.seed(5)
    assert_equal(ours.reset(), theirs.reset(), "reset")
    generator, ends = np.random.default_rng(0), 0
    for step in range(120):
        ours.action_space.seed(step)
        actions = np.stack([ours.action_space.sample() for _ in range(3)])
        if generator.random() < 0.1:
            actions[:] = actions[0]
        mine, other = ours.step(actions), theirs.step(actions)
        for one, two in zip(mine[:3], other[:3], strict=True):
            assert_equal(one, two, f"step {step}")
        for one, two in zip(mine[3], other[3], strict=True):
            assert_equal(one, two, f"info of step {step}")
        for one, two in zip(ours.reset_infos, theirs.reset_infos, strict=True):
            assert_equal(one, two, f"reset info of step {step}")
        ends += int(mine[2].sum())
    assert ends > 2


def test_infos_are_empty_but_for_ends() -> None:
    envs = as_vec_env(gymnasium.make_vec(ROOMS, num_envs=2, max_episode_steps=3))
    envs.reset()
    infos = [envs.step(np.array([0, 1]))[3] for _ in range(3)]
    assert infos[0] == infos[1] == [{}, {}]
    assert infos[2][0]["TimeLimit.truncated"] is True
    assert infos[2][0]["terminal_observation"].shape == envs.observation_space.shape
    assert infos[2][1]["is_success"] is False


@pytest.mark.parametrize(
    "make",
    [
        lambda: gymnasium.make_vec(ROOMS, num_envs=1, copy=False),
        lambda: SyncVectorEnv([lambda: gymnasium.make(ROOMS)], copy=False, autoreset_mode="SameStep"),
    ],
    ids=["engine", "sync"],
)
def test_observations_are_kept_apart_also_without_copies(make: Any) -> None:
    envs = as_vec_env(make())
    first = envs.reset()
    kept = first.copy()
    for _ in range(5):
        envs.step(np.array([0]))
    assert np.array_equal(first, kept)


def test_rewards_of_goals_are_those_of_a_single_environment_and_need_no_copy(monkeypatch: pytest.MonkeyPatch) -> None:
    arguments: dict[str, Any] = {"observation": "goal"}
    envs, single = as_vec_env(gymnasium.make_vec(REACH, num_envs=2, **arguments)), gymnasium.make(REACH, **arguments)
    monkeypatch.delattr(BatchedEnv, "sub_env")
    goals = np.random.default_rng(0).uniform(0, 0.08, (2, 64, 3))  # metres: around the threshold
    for achieved, desired in (goals, goals[:, 0]):
        expected = single.unwrapped.compute_reward(achieved, desired, {})  # type: ignore[attr-defined]
        (given,) = envs.env_method("compute_reward", achieved, desired, {}, indices=[1])
        assert_equal(given, expected)
    assert 0 < single.unwrapped.compute_reward(*goals, {}).sum() < 64  # type: ignore[attr-defined]


def test_attributes_and_methods_are_those_of_the_sub_environments() -> None:
    envs = as_vec_env(gymnasium.make_vec(REACH, num_envs=2, observation="goal"))
    envs.seed(0)
    seen = envs.reset()
    reward = envs.env_method("compute_reward", seen["desired_goal"], seen["desired_goal"], None, indices=0)
    assert np.array_equal(reward[0], np.ones(2))
    assert [one.observation_space for one in envs.get_attr("unwrapped")] == [envs.observation_space] * 2
    assert envs.env_is_wrapped(gymnasium.Wrapper) == [False, False]
    with pytest.raises(AttributeError, match="no attribute can be set"):
        envs.set_attr("substep", 3)
    with pytest.raises(AttributeError, match="nothing"):
        envs.get_attr("nothing", indices=[1])


def test_frames_come_from_the_engine() -> None:
    envs = as_vec_env(gymnasium.make_vec(ROOMS, num_envs=2, render_mode="rgb_array"))
    envs.reset()
    assert len(envs.get_images()) == 2
    frame = envs.render()
    assert frame is not None
    assert frame.ndim == 3


def test_no_info_is_shared_with_another_step() -> None:
    envs = as_vec_env(gymnasium.make_vec(ROOMS, num_envs=2))
    envs.reset()
    first, second = (envs.step(np.array([0, 1]))[3] for _ in range(2))
    second[1]["written"] = True
    assert first == [{}, {}]
    assert envs.step(np.array([0, 1]))[3] == [{}, {}]


def test_other_ways_to_reset_are_refused() -> None:
    with pytest.raises(ValueError, match='envs has autoreset_mode="NextStep"; it must be "SameStep"'):
        as_vec_env(gymnasium.make_vec(ROOMS, num_envs=2, autoreset_mode="NextStep"))
    with pytest.raises(ValueError, match="infos is 'some'; it must be 'ends' or 'all'"):
        as_vec_env(gymnasium.make_vec(ROOMS, num_envs=2), infos="some")  # type: ignore[arg-type]


def test_a_run_that_is_seeded_stays_so_beneath_a_wrapper(tmp_path: Path) -> None:
    recorded = VectorRecorder(gymnasium.make_vec(ROOMS, num_envs=2), 100, seeded=True)
    envs = as_vec_env(gymnasium.wrappers.vector.RecordEpisodeStatistics(recorded))
    assert list(envs.seed(3)) == [None, None]
    envs.reset()


def test_wrappers_of_single_environments_are_found() -> None:
    make = lambda: gymnasium.wrappers.TransformReward(gymnasium.make(ROOMS), lambda reward: reward)  # noqa: E731
    envs = as_vec_env(SyncVectorEnv([make, lambda: gymnasium.make(ROOMS)], autoreset_mode="SameStep"))
    assert envs.env_is_wrapped(gymnasium.wrappers.TransformReward) == [True, False]


def test_gymnasiums_own_vector_environment_is_taken_too() -> None:
    envs = as_vec_env(SyncVectorEnv([lambda: gymnasium.make(ROOMS)] * 2, autoreset_mode="SameStep"))
    envs.reset()
    assert envs.step(np.array([0, 1]))[0].shape == (2, *envs.observation_space.shape)


def flat(num_envs: int) -> Any:
    return gymnasium.make_vec(ROOMS, num_envs=num_envs, observation="flat")


def ppo(envs: Any) -> PPO:
    return PPO("MlpPolicy", envs, n_steps=64, batch_size=64, n_epochs=1, device="cpu", seed=0)


def test_a_recorded_training_scores_what_their_monitor_counts(tmp_path: Path) -> None:
    recorded = sprl_bench.record(flat(4), out=tmp_path, agent="sb3", seed=0, suite="smoke", budget=4_000)
    envs = VecNormalize(VecMonitor(as_vec_env(recorded), str(tmp_path / "monitor.csv")))
    evaluation = VecNormalize(VecMonitor(as_vec_env(flat(2))), training=False)
    callback = EvalCallback(evaluation, n_eval_episodes=2, eval_freq=500, verbose=0)
    model = ppo(envs).learn(4_096, callback=callback)
    envs.close()
    [record] = find_records(tmp_path)
    assert record.status == "complete"
    lines = (tmp_path / "monitor.csv").read_text().splitlines()[2:]
    counted = [float(line.split(",")[0]) for line in lines][: record.totals.episodes]
    assert record.totals.episodes > 20
    assert record.totals.mean_return == pytest.approx(np.mean(counted), abs=1e-5)
    assert callback.last_mean_reward >= 0
    assert len(evaluate_policy(model, VecMonitor(as_vec_env(flat(2))), 2)) == 2


class Learner:
    """An agent of Stable-Baselines3 for `sprl-bench run`."""

    def __init__(self, *, seed: int, device: str = "cpu") -> None:
        self.seed, self.device = seed, device

    def train(self, envs: Any, budget: int) -> Any:
        model = PPO("MlpPolicy", as_vec_env(envs), n_steps=64, batch_size=64, device=self.device, seed=self.seed)
        while True:
            model.learn(64 * envs.num_envs, reset_num_timesteps=False)
            yield {"updates": model._n_updates}


def test_their_agent_is_run_by_the_harness(tmp_path: Path) -> None:
    (spec,) = expand(find_suite("smoke"), [f"{__name__}:Learner"], [0], budget=3_000)
    record = run(spec, tmp_path)
    assert record.status == "complete"
    assert record.totals.env_steps == 3_000
