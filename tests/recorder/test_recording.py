"""`recording`: what a block takes for the run's environments, what it leaves out, and what it refuses."""

from __future__ import annotations

import contextlib
import functools
import gc
import multiprocessing
import time
from pathlib import Path
from typing import Any

import cloudpickle
import gymnasium
import pytest

import sprl_bench
from script_runs import ID, episodes, only_record, play, play_all
from sprl_bench.records import RunRecord, read


def test_stable_baselines_trains_inside_a_block(tmp_path: Path) -> None:
    from stable_baselines3 import PPO
    from stable_baselines3.common.env_util import make_vec_env

    with sprl_bench.recording(out=tmp_path, agent="sb3", seed=1, budget=256) as recording:
        with recording.paused():
            evaluation = make_vec_env(ID, 1)
        envs = make_vec_env(ID, 2, seed=1)
        assert type(envs.envs[0]).__name__ == "Monitor"
        assert type(evaluation.envs[0].env).__name__ != "EnvRecorder"
        PPO("MlpPolicy", envs, n_steps=64, n_epochs=1, batch_size=64, device="cpu").learn(256)
        evaluation.reset()
        for _ in range(5):
            evaluation.step([0])
    record = only_record(tmp_path)
    assert recording.folders == [record.spec.path(tmp_path)]
    assert (record.status, record.spec.num_envs, record.totals.env_steps) == ("complete", 2, 256)


def test_an_evaluation_environment_that_was_not_kept_out_is_noticed_at_once(tmp_path: Path) -> None:
    with sprl_bench.recording(out=tmp_path, agent="mine", seed=0):
        train, evaluation = gymnasium.make(ID), gymnasium.make(ID)
        evaluation.reset(seed=0)
        with pytest.raises(RuntimeError, match=r"not stepped in turn .* recording.paused\(\)"):
            play(train, 10)


def test_an_evaluation_environment_that_comes_later_is_refused(tmp_path: Path) -> None:
    with sprl_bench.recording(out=tmp_path, agent="mine", seed=0) as recording:
        play(gymnasium.make(ID), 10)
        with pytest.raises(ValueError, match=r"being recorded already. .* recording.paused\(\)"):
            gymnasium.make(ID)
        with recording.paused():
            play(gymnasium.make(ID), 50)
        gymnasium.make("CartPole-v1")
    assert only_record(tmp_path).totals.env_steps == 10


def test_an_environment_that_was_only_looked_at_is_no_member(tmp_path: Path) -> None:
    with sprl_bench.recording(out=tmp_path, agent="mine", seed=0):
        gymnasium.make(ID).close()
        assert gymnasium.make(ID).action_space.n == 7
        gc.collect()
        play(gymnasium.make(ID), 10)
    assert only_record(tmp_path).totals.env_steps == 10


def test_what_is_made_after_the_record_is_not_recorded(tmp_path: Path) -> None:
    """A script may well end with an evaluation."""
    with sprl_bench.recording(out=tmp_path, agent="mine", seed=0, budget=100):
        play(gymnasium.make(ID), 100)
        with pytest.warns(UserWarning, match="seed-0 has its record by now, so a further environment is not recorded"):
            play(gymnasium.make(ID), 50)
    assert only_record(tmp_path).totals.env_steps == 100


def test_an_environment_that_was_closed_before_its_first_step_is_not_counted(tmp_path: Path) -> None:
    with sprl_bench.recording(out=tmp_path, agent="mine", seed=0, budget=400):
        gymnasium.make_vec(ID, 3).close()
        gymnasium.make(ID).close()
        env = gymnasium.make(ID)
        gymnasium.make(ID).close()
        play(env, 400)
    record = only_record(tmp_path)
    assert (record.status, record.spec.num_envs) == ("complete", 1)


def test_an_evaluation_environment_beside_a_vector_environment_is_refused(tmp_path: Path) -> None:
    with sprl_bench.recording(out=tmp_path, agent="mine", seed=0, budget=400) as recording:
        envs = gymnasium.make_vec(ID, 2)
        with pytest.raises(ValueError, match=r"being recorded already. .* recording.paused\(\)"):
            gymnasium.make(ID)
        with recording.paused():
            play(gymnasium.make(ID), 10)
        play_all(envs, 200)
    record = only_record(tmp_path)
    assert (record.status, record.spec.num_envs) == ("complete", 2)


def test_an_environment_that_is_forgotten_late_takes_no_other_one_with_it(tmp_path: Path) -> None:
    with sprl_bench.recording(out=tmp_path, agent="mine", seed=0, budget=400):
        env: Any = gymnasium.make_vec(ID, 3)
        env.close()
        env = gymnasium.make(ID)
        gc.collect()
        evaluation = gymnasium.make(ID)
        evaluation.reset(seed=0)
        with pytest.raises(RuntimeError, match="not stepped in turn"):
            play(env, 400)


def test_a_seed_is_taken_again_when_the_block_is_over(tmp_path: Path) -> None:
    with sprl_bench.recording(out=tmp_path, agent="mine", seed=0):
        envs = [gymnasium.make(ID), gymnasium.make_vec("SPRL/KeyDoors-7x7-v1", 2)]
        for env in envs:
            env.reset(seed=0)
            env.step(env.action_space.sample())
    for env in envs:
        env.reset(seed=5)


def test_environments_are_numbered_among_those_that_took_a_step(tmp_path: Path) -> None:
    with sprl_bench.recording(out=tmp_path, agent="mine", seed=0, budget=400):
        gymnasium.make(ID).close()
        play(gymnasium.make(ID), 400)
    assert only_record(tmp_path).spec.num_envs == 1
    assert set(episodes(tmp_path)["env"]) == {0}


def test_a_block_notes_privileges_and_hyperparameters(tmp_path: Path) -> None:
    with sprl_bench.recording(
        out=tmp_path, agent="mine", seed=0, budget=10, privileged=True, hyperparameters={"rate": 0.1}
    ):
        play(gymnasium.make(ID), 10)
    assert (only_record(tmp_path).spec.privileged, only_record(tmp_path).spec.hyperparameters) == (True, {"rate": 0.1})


def test_a_block_records_each_task_and_puts_gymnasium_back(tmp_path: Path) -> None:
    before = gymnasium.make, gymnasium.make_vec
    with (
        contextlib.suppress(ZeroDivisionError),
        sprl_bench.recording(out=tmp_path, agent="mine", seed=0, suite="grid") as block,
    ):
        play_all(gymnasium.make_vec(ID, 2), 60)
        play(gymnasium.make("SPRL/KeyDoors-7x7-v1"), 10)
        with (
            pytest.raises(RuntimeError, match="cannot lie within one another"),
            sprl_bench.recording(out=tmp_path, agent="other", seed=0),
        ):
            pass
        raise ZeroDivisionError
    assert (gymnasium.make, gymnasium.make_vec) == before
    assert [folder.parent.parent.name for folder in block.folders] == ["FourRooms-7x7", "KeyDoors-7x7"]
    found = [read(folder / "record.json", RunRecord) for folder in block.folders]
    assert [record.status for record in found] == ["incomplete", "incomplete"]
    assert [record.totals.env_steps for record in found] == [120, 10]


def test_a_block_that_recorded_nothing_says_so(tmp_path: Path) -> None:
    with (
        pytest.warns(UserWarning, match="Nothing was recorded"),
        sprl_bench.recording(out=tmp_path, agent="mine", seed=0),
    ):
        gymnasium.make("CartPole-v1")


# --------------------------------------------------------------------------- processes, and libraries that seed


@pytest.mark.parametrize("start_method", [None, "spawn"])
def test_a_library_that_puts_environments_into_processes_is_refused_at_the_start(
    start_method: str | None, tmp_path: Path
) -> None:
    from stable_baselines3.common.env_util import make_vec_env
    from stable_baselines3.common.vec_env import SubprocVecEnv

    with (
        pytest.warns(UserWarning, match="Nothing was recorded"),
        sprl_bench.recording(out=tmp_path, agent="mine", seed=0),
        pytest.raises(RuntimeError, match=r"recording\(\) cannot record there. .* DummyVecEnv.*recording.paused\(\)"),
    ):
        make_vec_env(ID, 2, vec_env_cls=SubprocVecEnv, vec_env_kwargs={"start_method": start_method})  # type: ignore[arg-type]
    assert list(tmp_path.iterdir()) == []


def test_a_make_of_the_block_cannot_be_sent_to_another_process(tmp_path: Path) -> None:
    """TorchRL does so for `GymEnv(..., num_envs=2)`."""
    with (
        pytest.warns(UserWarning, match="Nothing was recorded"),
        sprl_bench.recording(out=tmp_path, agent="mine", seed=0),
        pytest.raises(RuntimeError, match=r"recording\(\) does not reach into other processes"),
    ):
        cloudpickle.dumps(functools.partial(gymnasium.make, ID))
    assert list(tmp_path.iterdir()) == []


def test_environments_for_evaluation_may_have_processes(tmp_path: Path) -> None:
    from stable_baselines3.common.env_util import make_vec_env
    from stable_baselines3.common.vec_env import SubprocVecEnv

    with sprl_bench.recording(out=tmp_path, agent="mine", seed=0) as block:
        with block.paused():
            evaluation = make_vec_env(ID, 1, vec_env_cls=SubprocVecEnv, vec_env_kwargs={"start_method": "fork"})  # type: ignore[arg-type]
        play(gymnasium.make(ID), 10)
        evaluation.reset()
        evaluation.close()
    assert only_record(tmp_path).totals.env_steps == 10


def test_processes_of_other_kinds_are_started_and_none_is_refused_after_the_block(tmp_path: Path) -> None:
    start = multiprocessing.process.BaseProcess.start
    with sprl_bench.recording(out=tmp_path, agent="mine", seed=0):
        process = multiprocessing.Process(target=time.sleep, args=(0,))
        process.start()
        process.join()
        envs = gymnasium.make_vec(ID, 2, vectorization_mode="async")
        play_all(envs, 60)
        envs.close()
    assert process.exitcode == 0
    assert only_record(tmp_path).totals.env_steps == 120
    assert multiprocessing.process.BaseProcess.start is start


def test_a_model_that_is_loaded_with_its_environment_is_told_what_to_do_instead(tmp_path: Path) -> None:
    from stable_baselines3 import PPO

    env = sprl_bench.record(gymnasium.make(ID), out=tmp_path, agent="mine", seed=0, budget=1_000)
    model = PPO("MlpPolicy", env, n_steps=64, n_epochs=1, seed=3, device="cpu").learn(64)
    model.save(tmp_path / "model")
    loaded = PPO.load(tmp_path / "model", env=env, device="cpu")
    with pytest.raises(ValueError, match=r"seed is 3, .* load the model without env, then call set_env"):
        loaded.learn(64)
    again = PPO.load(tmp_path / "model", device="cpu")
    again.set_env(env)
    again.learn(64)
    env.close()
    assert only_record(tmp_path).totals.env_steps == 128


def test_an_environment_outlives_its_block_also_with_actions_kept(tmp_path: Path) -> None:
    with sprl_bench.recording(out=tmp_path, agent="mine", seed=0, budget=100, keep_actions=True):
        env = gymnasium.make(ID)
        env.reset(seed=0)
        env.step(0)
    env.reset(seed=1)
    env.step(0)
    env.close()
    assert only_record(tmp_path).totals.env_steps == 1


@pytest.mark.parametrize("observation", ["cells", "flat", "one-hot"])
def test_normalised_environments_and_an_evaluation_callback_are_recorded_as_the_monitor_counts(
    observation: str, tmp_path: Path
) -> None:
    from stable_baselines3 import PPO
    from stable_baselines3.common.callbacks import EvalCallback
    from stable_baselines3.common.env_util import make_vec_env
    from stable_baselines3.common.vec_env import VecNormalize

    keywords = {"observation": observation}
    with sprl_bench.recording(out=tmp_path, agent="sb3", seed=1, budget=512) as block:
        monitored = make_vec_env(ID, 2, seed=1, env_kwargs=keywords)
        with block.paused():
            evaluation = VecNormalize(make_vec_env(ID, 1, env_kwargs=keywords), training=False)
        callback = EvalCallback(evaluation, eval_freq=128, n_eval_episodes=1, verbose=0)
        model = PPO("MlpPolicy", VecNormalize(monitored), n_steps=64, n_epochs=1, batch_size=64, device="cpu")
        model.learn(512, callback=callback)
        counted = [returned for env in monitored.envs for returned in env.get_episode_rewards()]  # type: ignore[attr-defined]
    assert callback.n_calls == 256
    assert only_record(tmp_path).status == "complete"
    assert sorted(episodes(tmp_path)["return"]) == pytest.approx(sorted(counted), abs=1e-5)
