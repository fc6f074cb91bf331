"""The contract of the single Fetch environments."""

from __future__ import annotations

import copy
import pickle
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.error import ResetNeeded
from gymnasium.utils.env_checker import check_env

import sprl_bench.envs

pytest.importorskip("mujoco")
pytest.importorskip("gymnasium_robotics")
sprl_bench.envs.register()

from sprl_bench.envs.fetch.rules import Rules, checked_actions  # noqa: E402

TASKS = ("Reach", "Push", "Slide", "PickAndPlace")
MODES = ("flat", "goal")


def make(task: str = "Reach", **arguments: Any) -> Any:
    return gymnasium.make(f"SPRL/Fetch{task}Sparse-v1", **arguments).unwrapped


def play(env: Any, steps: int, seed: int = 0) -> list[Any]:
    """Act at random, through automatic resets."""
    seen: list[Any] = []
    for action in np.random.default_rng(seed).uniform(-1, 1, (steps, 4)):
        observation, reward, terminated, truncated, info = env.step(action)
        seen.append((observation.tolist(), reward, terminated, truncated, info["applied_action"].tolist()))
        if terminated or truncated:
            seen.append(env.reset()[0].tolist())
    return seen


@pytest.mark.parametrize("observation", MODES)
@pytest.mark.parametrize("task", TASKS)
@pytest.mark.filterwarnings("ignore:.*Box observation space (min|max)imum value is")
def test_the_checkers_of_gymnasium_and_of_stable_baselines_accept(task: str, observation: str) -> None:
    from stable_baselines3.common.env_checker import check_env as sb3_check_env

    env = gymnasium.make(f"SPRL/Fetch{task}Sparse-v1", observation=observation)
    check_env(env.unwrapped, skip_render_check=True)
    sb3_check_env(env.unwrapped, skip_render_check=True)


@pytest.mark.parametrize(("task", "size"), [("Reach", 16), ("Push", 31), ("Slide", 31), ("PickAndPlace", 31)])
def test_spaces_types_and_information(task: str, size: int) -> None:
    env = make(task)
    assert env.observation_space == gymnasium.spaces.Box(-np.inf, np.inf, (size,), np.float64)
    assert env.action_space == gymnasium.spaces.Box(-1.0, 1.0, (4,), np.float32)
    observation, info = env.reset(seed=0)
    assert observation in env.observation_space
    assert list(info) == ["is_success"]
    assert type(info["is_success"]) is bool
    observation, reward, terminated, truncated, info = env.step([0.5, 0, 0, 0])
    assert observation in env.observation_space
    assert (type(reward), type(terminated), type(truncated)) == (float, bool, bool)
    assert sorted(info) == ["applied_action", "is_success"]
    assert type(info["is_success"]) is bool
    assert info["applied_action"].dtype == np.float32
    assert info["applied_action"].tolist() == [0.5, 0, 0, 0]


def test_the_specs_serialise_and_the_module_form_works_in_other_processes() -> None:
    env = gymnasium.make("SPRL/FetchReachSparse-v1", substep=3, observation="goal")
    again = gymnasium.make(gymnasium.envs.registration.EnvSpec.from_json(env.spec.to_json()))
    assert (again.unwrapped.rules.substep, type(again.unwrapped)) == (3, type(env.unwrapped))
    name = "sprl_bench:SPRL/FetchReachSparse-v1"
    envs = gymnasium.vector.AsyncVectorEnv([lambda: gymnasium.make(name)] * 2, context="spawn")
    single = make()
    assert np.array_equal(envs.reset(seed=4)[0][1], single.reset(seed=5)[0])
    assert np.array_equal(envs.step(np.ones((2, 4)))[0][1], single.step(np.ones(4))[0])
    envs.close()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"substep": 0}, "substep is 0; it must be an integer from 1 to 500"),
        ({"substep": -1}, "substep is -1; it must be an integer from 1 to 500"),
        ({"substep": 501}, "substep is 501; it must be an integer from 1 to 500"),
        ({"substep": 2.5}, "substep is 2.5; it must be an integer from 1 to 500"),
        ({"substep": "3"}, "substep is '3'; it must be an integer from 1 to 500"),
        ({"substep": True}, "substep is True; it must be an integer from 1 to 500"),
        ({"action_noise": -0.1}, "action_noise is -0.1; it must be a finite number of at least 0"),
        ({"action_noise": np.nan}, "action_noise is nan; it must be a finite number of at least 0"),
        ({"action_noise": np.inf}, "action_noise is inf; it must be a finite number of at least 0"),
        ({"action_noise": "0.1"}, "action_noise is '0.1'; it must be a finite number of at least 0"),
        ({"action_noise": True}, "action_noise is True; it must be a finite number of at least 0"),
        ({"terminate_on_goal": 1}, "terminate_on_goal is 1; it must be True or False"),
        ({"observation": "Goal"}, "observation is 'Goal'; it must be one of 'flat', 'goal'. Did you mean 'goal'?"),
        ({"render_mode": "rgb"}, "render_mode is 'rgb'; it must be one of None, 'human', 'rgb_array'"),
        ({"n_substeps": 3}, "unexpected keyword argument 'n_substeps' (value 3); it takes action_noise, observation, "),
        ({"frame_skip": 3}, "terminate_on_goal. Did you mean 'substep'?"),
        ({"sub_step": 3}, "Did you mean 'substep'?"),
        ({"noise": 3}, "terminate_on_goal. Did you mean 'action_noise'?"),
        ({"gravity": 3}, "it takes action_noise, observation, render_mode, substep, terminate_on_goal."),
    ],
)
@pytest.mark.filterwarnings("ignore:.*The environment is being initialised with render_mode")
def test_bad_arguments_are_named(arguments: dict[str, Any], message: str) -> None:
    with pytest.raises((TypeError, ValueError)) as error:
        make(**arguments)
    assert message in str(error.value)


def test_arguments_are_keyword_only() -> None:
    from sprl_bench.envs.fetch import fetch_env as env

    with pytest.raises(TypeError, match="positional"):
        env.reach(3)


@pytest.mark.parametrize(
    ("substep", "horizon"), [(1, 1000), (2, 500), (3, 333), (6, 167), (7, 143), (16, 62), (20, 50), (80, 12), (500, 2)]
)
def test_episode_length_times_substep_stays_the_same(substep: int, horizon: int) -> None:
    """1000 / 16 and 1000 / 80 end in a half, and round to the even neighbour."""
    assert Rules(substep=substep).horizon == horizon


@pytest.mark.parametrize(("substep", "horizon"), [(70, 14), (80, 12), (500, 2)])
def test_the_horizon_truncates_and_does_not_terminate(substep: int, horizon: int) -> None:
    env = make("Push", substep=substep, terminate_on_goal=False)
    env.reset(seed=0)
    ends = [env.step(np.zeros(4))[2:4] for _ in range(horizon)]
    assert ends == [(False, False)] * (horizon - 1) + [(False, True)]


def bring_the_goal(env: Any) -> None:
    env.simulation.goal = env.simulation._get_obs()["achieved_goal"].copy()


def test_reaching_the_goal_pays_one_and_only_terminates_even_on_the_last_step() -> None:
    env = make(substep=250)
    for wait in (0, 3):
        env.reset(seed=0)
        for _ in range(wait):
            assert env.step([1, 1, 0, 0])[1:4] == (0.0, False, False)
        bring_the_goal(env)
        _, reward, terminated, truncated, info = env.step(np.zeros(4))
        assert (reward, terminated, truncated, info["is_success"]) == (1.0, True, False, True)


def test_without_termination_the_goal_pays_again_and_only_the_horizon_ends() -> None:
    env = make(substep=250, terminate_on_goal=False)
    env.reset(seed=0)
    bring_the_goal(env)
    ends = [env.step(np.zeros(4))[1:4] for _ in range(4)]
    assert ends == [(1.0, False, False)] * 3 + [(1.0, False, True)]


def test_compute_reward_prices_any_number_of_goals_alike() -> None:
    env = make(observation="goal")
    origin = np.zeros((3, 3))
    goals = np.array([[0.0499, 0, 0], [0.03, 0.04, 0.0], [0.0501, 0, 0]])
    rewards = env.compute_reward(origin, goals, [{}, {}, {}])
    assert rewards.tolist() == [1.0, float(np.linalg.norm(goals[1]) <= 0.05), 0.0]
    assert rewards.dtype == np.float64
    for goal, reward in zip(goals, rewards, strict=True):
        assert env.compute_reward(origin[0], goal, {}) == reward
        assert env.compute_terminated(origin[0], goal, {}) == bool(reward)
    assert not make(observation="goal", terminate_on_goal=False).compute_terminated(origin, goals, {}).any()


@pytest.mark.parametrize("terminate_on_goal", [True, False])
def test_a_goal_environment_computes_what_it_returned(terminate_on_goal: bool) -> None:
    env = make(observation="goal", substep=100, terminate_on_goal=terminate_on_goal)
    for seed in range(3):
        observation, _ = env.reset(seed=seed)
        ended = False
        while not ended:
            aim = 10 * (observation["desired_goal"] - observation["achieved_goal"])
            observation, reward, terminated, truncated, info = env.step(np.append(aim, 0))
            goals = observation["achieved_goal"], observation["desired_goal"], info
            assert env.compute_reward(*goals) == reward
            assert env.compute_terminated(*goals) == terminated
            assert env.compute_truncated(*goals) == truncated
            ended = terminated or truncated


def test_noise_is_a_function_of_the_seed_alone() -> None:
    np.random.seed(0)  # noqa: NPY002 - to show that nothing draws from it
    before = np.random.get_state()[1].tolist()  # noqa: NPY002
    streams = []
    for seed in (1, 1, 2):
        env = make(action_noise=0.1, substep=50)
        start = env.reset(seed=seed)[0].tolist()
        streams.append([start, *play(env, 60)])
    assert streams[0] == streams[1] != streams[2]
    assert np.random.get_state()[1].tolist() == before  # noqa: NPY002


def test_no_noise_draws_nothing() -> None:
    quiet, plain = make(action_noise=0, substep=50), make(substep=50)
    assert quiet.reset(seed=1)[0].tolist() == plain.reset(seed=1)[0].tolist()
    assert play(quiet, 60) == play(plain, 60)
    assert play(quiet, 1)[0][4] == pytest.approx(np.random.default_rng(0).uniform(-1, 1, 4), abs=1e-7)


def test_noise_has_its_standard_deviation_before_it_is_clipped() -> None:
    rules, generator = Rules(action_noise=0.1), np.random.default_rng(0)
    centred = rules.applied(np.zeros((20_000, 4), np.float32), [generator] * 20_000)
    assert centred.dtype == np.float32
    assert np.std(centred, axis=0) == pytest.approx(0.1, rel=0.03)
    assert np.mean(centred, axis=0) == pytest.approx(0, abs=0.003)
    edge = rules.applied(np.ones((2_000, 4), np.float32), [generator] * 2_000)
    assert edge.max() == 1.0
    assert np.mean(edge == 1.0) == pytest.approx(0.5, abs=0.03)


def test_the_applied_action_is_what_moves_the_arm() -> None:
    noisy, plain = make(action_noise=0.5), make()
    start, _ = noisy.reset(seed=3)
    assert np.array_equal(plain.reset(seed=3)[0], start)
    observation, *_, info = noisy.step([0.9, 0.0, -0.9, 0.0])
    assert np.abs(info["applied_action"]).max() <= 1.0
    assert info["applied_action"].tolist() != pytest.approx([0.9, 0.0, -0.9, 0.0], abs=0.01)
    assert np.array_equal(plain.step(info["applied_action"])[0], observation)


def test_actions_are_cast_to_float32_and_clipped() -> None:
    double = np.array([0.1, -3.0, 1e-9, 2.0])
    observations = []
    for action in (double, double.astype(np.float32), double.tolist(), [0.1, -1, np.float32(1e-9), 1]):
        env = make("PickAndPlace")
        env.reset(seed=0)
        observations.append(env.step(action)[0].tolist())
    assert all(observation == observations[0] for observation in observations)


@pytest.mark.parametrize(
    ("action", "error", "message"),
    [
        (np.full(4, np.nan), ValueError, "; it must be finite"),
        ([0, 0, np.inf, 0], ValueError, "; it must be finite"),
        ([0, 0, 1e300, 0], ValueError, "; it must be finite"),
        (np.zeros(3), ValueError, r"action has shape \(3,\); it must be of shape \(4,\)"),
        (np.zeros((1, 4)), ValueError, r"action has shape \(1, 4\); it must be of shape \(4,\)"),
        (0.0, ValueError, r"action has shape \(\); it must be of shape \(4,\)"),
        (["a"] * 4, TypeError, "; it must be an array of real numbers"),
        (None, TypeError, "; it must be an array of real numbers"),
        (np.zeros(4, complex), TypeError, "; it must be an array of real numbers"),
    ],
)
def test_bad_actions_are_refused_and_change_nothing(action: Any, error: type[Exception], message: str) -> None:
    env, twin = make("PickAndPlace", action_noise=0.1), make("PickAndPlace", action_noise=0.1)
    assert env.reset(seed=0)[0].tolist() == twin.reset(seed=0)[0].tolist()
    with pytest.raises(error, match=message):
        env.step(action)
    assert play(env, 3) == play(twin, 3)


def test_actions_of_sub_environments_that_are_not_used_may_be_anything() -> None:
    actions = np.array([[0.0] * 4, [np.nan] * 4])
    assert checked_actions(actions, (2, 4), np.array([True, False])).dtype == np.float32
    with pytest.raises(ValueError, match="finite"):
        checked_actions(actions, (2, 4), np.array([False, True]))


def test_nothing_is_done_before_a_reset() -> None:
    env = make(render_mode="rgb_array")
    for function in (env.render, lambda: env.step(np.zeros(4))):
        with pytest.raises(ResetNeeded):
            function()


@pytest.mark.parametrize("copied", [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))])
@pytest.mark.parametrize(("task", "substep"), [("Reach", 50), ("Push", 50), ("Slide", 50), ("PickAndPlace", 3)])
def test_a_copy_continues_the_stream_exactly(task: str, substep: int, copied: Any) -> None:
    env = gymnasium.make(f"SPRL/Fetch{task}Sparse-v1", substep=substep, action_noise=0.1)
    env.reset(seed=2)
    play(env, 7)
    twin = copied(env)
    assert play(twin, 45, seed=1) == play(env, 45, seed=1)
    assert twin.spec == env.spec
    assert twin.unwrapped.metadata == env.unwrapped.metadata


@pytest.mark.parametrize("observation", MODES)
def test_a_simulation_that_diverges_ends_its_episode_and_leaves_nothing_behind(
    observation: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)  # MuJoCo logs there
    env, twin = make("Push", observation=observation), make("Push", observation=observation)
    env.reset(seed=0)
    twin.reset(seed=0)
    last = env.step(np.ones(4))[0]
    env.simulation.data.qvel[3] = np.nan
    shown, reward, terminated, truncated, info = env.step(np.ones(4))
    np.testing.assert_equal(shown, last)
    assert (reward, terminated, truncated) == (0.0, False, True)
    assert (info["diverged"], info["is_success"]) == (True, False)
    np.testing.assert_equal(env.reset()[0], twin.reset()[0])
    for _ in range(3):
        ours, expected = env.step(np.ones(4)), twin.step(np.ones(4))
        np.testing.assert_equal(ours, expected)
        assert "diverged" not in ours[4]


def test_the_frame_rate_follows_the_substep() -> None:
    assert [make(substep=number).metadata["render_fps"] for number in (1, 3, 20, 500)] == [500, 167, 25, 1]
    assert make().metadata["render_fps"] == 25


def test_an_unmodified_script_of_stable_baselines_learns_from_hindsight() -> None:
    from stable_baselines3 import SAC, HerReplayBuffer

    env = gymnasium.make("SPRL/FetchReachSparse-v1", observation="goal", terminate_on_goal=False)
    model = SAC(
        "MultiInputPolicy", env, replay_buffer_class=HerReplayBuffer, learning_starts=1_500, seed=0, device="cpu"
    )
    model.learn(total_timesteps=2_000)
    assert model.num_timesteps == 2_000
    rewards = model.replay_buffer.sample(256).rewards
    assert 0 < rewards.sum() < 256  # relabelled goals are reached, others are not


@pytest.mark.parametrize("arguments", [{}, {"substep": 20}, {"substep": 20, "observation": "goal"}])
def test_the_recorder_knows_the_task_however_its_defaults_are_spelt(arguments: dict[str, Any], tmp_path: Any) -> None:
    from sprl_bench.recorder.identity import choose_task, identify

    env = gymnasium.make("SPRL/FetchReachSparse-v1", **arguments)
    suite, task = choose_task(identify(env), None, None)
    assert (suite.name, task.name) == ("fetch", "FetchReach")
    env.close()
