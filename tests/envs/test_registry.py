"""Every id, however it is made: names, specs, fresh interpreters, refused arguments."""

from __future__ import annotations

import subprocess
import sys

import gymnasium
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec
from gymnasium.vector import AsyncVectorEnv, AutoresetMode, SyncVectorEnv

import sprl_bench
from sprl_bench.envs import GRID_IDS as IDS
from sprl_bench.envs import register


def in_fresh_interpreter(code: str) -> str:
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


def test_the_ids_are_those_of_the_protocol() -> None:
    assert IDS == (
        "SPRL/FourRooms-7x7-v1", "SPRL/FourRooms-11x11-v1", "SPRL/KeyDoors-7x7-v1", "SPRL/KeyDoors-11x11-v1",
    )  # fmt: skip


@pytest.mark.parametrize("env_id", IDS)
def test_an_id_describes_what_it_makes(env_id: str) -> None:
    size = 11 if "11x11" in env_id else 7
    assert gymnasium.spec(env_id).max_episode_steps is None
    for made in (gymnasium.make(env_id), gymnasium.make_vec(env_id, 3)):
        space = getattr(made, "single_observation_space", made.observation_space)
        assert space == gymnasium.spaces.Box(0, 255, (size, size, 3), np.uint8)
        assert getattr(made, "single_action_space", made.action_space) == gymnasium.spaces.Discrete(7)
        assert made.spec is not None
        assert made.spec.id == env_id


def test_registering_twice_changes_nothing() -> None:
    before = {env_id: gymnasium.spec(env_id) for env_id in IDS}
    register()
    gymnasium.register_envs(sprl_bench)
    assert {env_id: gymnasium.spec(env_id) for env_id in IDS} == before


@pytest.mark.parametrize("env_id", IDS)
def test_the_spec_of_a_single_environment_survives_json(env_id: str) -> None:
    spec = gymnasium.make(env_id, render_mode="rgb_array").spec
    again = EnvSpec.from_json(spec.to_json())
    assert again == spec
    env = gymnasium.make(again)
    assert env.render_mode == "rgb_array"
    np.testing.assert_array_equal(env.reset(seed=1)[0], gymnasium.make(env_id).reset(seed=1)[0])


@pytest.mark.parametrize("mode", ["NextStep", AutoresetMode.NEXT_STEP])
def test_the_spec_of_an_engine_survives_json(mode: str | AutoresetMode) -> None:
    spec = gymnasium.make_vec(IDS[2], 4, autoreset_mode=mode, num_threads=2, max_episode_steps=9).spec
    again = EnvSpec.from_json(spec.to_json())
    assert again == spec
    envs = gymnasium.make_vec(again)
    assert envs.num_envs == 4
    assert envs.metadata["autoreset_mode"] is AutoresetMode.NEXT_STEP
    assert envs.spec.kwargs["autoreset_mode"] == "NextStep"


def test_importing_registers_and_loads_nothing_heavy() -> None:
    loaded = in_fresh_interpreter(
        "import sys, sprl_bench, gymnasium\n"
        "assert gymnasium.spec('SPRL/FourRooms-7x7-v1')\n"
        "heavy = ('torch', 'mujoco', 'numba', 'minigrid', 'pandas', 'pyarrow', 'pydantic', 'matplotlib')\n"
        "print([name for name in heavy if name in sys.modules])"
    )
    assert loaded == "[]"


@pytest.mark.parametrize(
    "code",
    [
        "import gymnasium; env = gymnasium.make('sprl_bench:SPRL/FourRooms-7x7-v1')",
        "import gymnasium; env = gymnasium.make_vec('sprl_bench:SPRL/FourRooms-7x7-v1', num_envs=2)",
        "import gymnasium, sprl_bench as ours; gymnasium.register_envs(ours); env = gymnasium.make(ours.envs.IDS[0])",
    ],
)
def test_each_way_of_naming_an_id_works_in_a_fresh_interpreter(code: str) -> None:
    assert in_fresh_interpreter(f"{code}; env.reset(seed=0); print(type(env.step(env.action_space.sample())[0]))")


def test_numba_is_loaded_only_by_an_engine() -> None:
    assert in_fresh_interpreter(
        "import sys, gymnasium\n"
        "gymnasium.make('sprl_bench:SPRL/KeyDoors-7x7-v1').reset(seed=0)\n"
        "print('numba' in sys.modules)"
    ) == "False"  # fmt: skip


def test_spawned_workers_know_the_ids() -> None:
    env_id = f"sprl_bench:{IDS[2]}"
    workers = AsyncVectorEnv([lambda: gymnasium.make(env_id)] * 2, context="spawn", autoreset_mode="SameStep")
    here = gymnasium.make_vec(env_id, 2)
    try:
        np.testing.assert_array_equal(workers.reset(seed=4)[0], here.reset(seed=4)[0])
        rng = np.random.default_rng(0)
        for _ in range(120):
            actions = rng.integers(7, size=2)
            for theirs, ours in zip(workers.step(actions)[:4], here.step(actions)[:4], strict=True):
                np.testing.assert_array_equal(theirs, ours)
    finally:
        workers.close()


def test_every_vectorization_mode_is_the_same_environment() -> None:
    kinds = [type(gymnasium.make_vec(IDS[0], 2, vectorization_mode=mode)) for mode in (None, "sync")]
    assert kinds[0].__name__ == "FourRooms7x7Engine"
    assert kinds[1] is SyncVectorEnv


@pytest.mark.parametrize("make", [gymnasium.make, gymnasium.make_vec])
def test_arguments_that_do_not_exist_are_named_with_a_suggestion(make) -> None:
    with pytest.raises(TypeError, match=r"unexpected keyword argument 'rendermode' .*Did you mean 'render_mode'\?"):
        make(IDS[0], rendermode="human")
    with pytest.raises(TypeError, match="unexpected keyword argument 'size'"):
        make(IDS[0], size=9)


@pytest.mark.filterwarnings("ignore:.*not in the possible render_modes")
@pytest.mark.parametrize("make", [gymnasium.make, gymnasium.make_vec])
def test_a_wrong_render_mode_is_named_with_a_suggestion(make) -> None:
    with pytest.raises(
        ValueError, match=r"render_mode is 'rgb_aray'; it must be one of .*\. Did you mean 'rgb_array'\?"
    ):
        make(IDS[0], render_mode="rgb_aray")


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        ({"num_envs": 0}, ValueError, "num_envs is 0; it must be an integer of at least 1"),
        ({"num_envs": 2.0}, TypeError, "num_envs is 2.0; it must be an integer of at least 1"),
        ({"num_envs": True}, TypeError, "num_envs is True; it must be an integer"),
        ({"num_threads": 0}, ValueError, "num_threads is 0; it must be an integer of at least 1"),
        ({"num_threads": "2"}, TypeError, "num_threads is '2'; it must be an integer"),
        ({"max_episode_steps": 0}, ValueError, "max_episode_steps is 0; it must be an integer of at least 1"),
        ({"max_episode_steps": -2}, ValueError, "max_episode_steps"),
        ({"max_episode_steps": 5.0}, TypeError, "max_episode_steps"),
        (
            {"autoreset_mode": "samestep"},
            ValueError,
            r"autoreset_mode is 'samestep'; it must be one of .* Did you mean 'SameStep'\?",
        ),
        ({"autoreset_mode": None}, ValueError, "autoreset_mode is None; it must be one of"),
        ({"copy": "no"}, ValueError, "copy is 'no'; it must be one of True, False"),
        ({"num_thread": 2}, TypeError, r"Did you mean 'num_threads'\?"),
    ],
)
def test_a_wrong_argument_of_an_engine_is_named(arguments: dict, error: type[Exception], message: str) -> None:
    with pytest.raises(error, match=message):
        gymnasium.make_vec(IDS[0], **arguments)
