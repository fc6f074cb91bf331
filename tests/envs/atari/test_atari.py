"""The Atari games: Table 3 row by row, the engine against single environments, and the replay that is their state."""

from __future__ import annotations

import copy
import json
import pickle
import subprocess
import sys
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.error import ResetNeeded
from gymnasium.spaces import Box, Discrete
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AsyncVectorEnv, AutoresetMode, SyncVectorEnv

import sprl_bench  # noqa: F401 - registers the ids
from sprl_bench.envs import ATARI_IDS as IDS
from sprl_bench.run import InterruptedRunError, run
from sprl_bench.suite import expand
from sprl_bench.tasks import REFERENCES, SUITES

ale_py = pytest.importorskip("ale_py")

from sprl_bench.envs.atari import emulators as emulators_module  # noqa: E402 - needs the extra
from sprl_bench.envs.atari.emulators import Emulators  # noqa: E402
from sprl_bench.envs.atari.preprocessing import HORIZON, SETTINGS  # noqa: E402

PACMAN = "SPRL/MsPacman-v1"
MODES = [mode.value for mode in AutoresetMode]


@pytest.fixture
def short_blocks(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let a few episodes need several seeds."""
    monkeypatch.setattr(emulators_module, "BLOCK", 2)


def _engine(env_id: str, num_envs: int, **arguments: Any) -> Any:
    return gymnasium.make_vec(env_id, num_envs=num_envs, **arguments)


def _sync(env_id: str, num_envs: int, mode: str = "SameStep", **arguments: Any) -> SyncVectorEnv:
    kwargs = {"autoreset_mode": AutoresetMode(mode)}
    envs = gymnasium.make_vec(env_id, num_envs=num_envs, vectorization_mode="sync", vector_kwargs=kwargs, **arguments)
    assert isinstance(envs, SyncVectorEnv)
    return envs


def _actions(num_envs: int, steps: int, seed: int = 0) -> Iterator[Any]:
    yield from np.random.default_rng(seed).integers(0, 18, (steps, num_envs))


def _assert_equal(ours: Any, theirs: Any) -> None:
    if isinstance(theirs, dict):
        assert ours.keys() == theirs.keys()
        for name in theirs:
            _assert_equal(ours[name], theirs[name])
    elif isinstance(theirs, tuple):
        for one, other in zip(ours, theirs, strict=True):
            _assert_equal(one, other)
    elif isinstance(theirs, np.ndarray) and theirs.dtype == object:
        for one, other in zip(ours, theirs, strict=True):
            assert (one is None) == (other is None)
            if other is not None:
                np.testing.assert_array_equal(one, other)
    else:
        np.testing.assert_array_equal(ours, theirs)
        assert np.asarray(ours).dtype == np.asarray(theirs).dtype


# ------------------------------------------------------------------------------------------- Table 3


@pytest.mark.parametrize("env_id", IDS)
def test_spaces_are_those_of_table_3(env_id: str) -> None:
    env = gymnasium.make(env_id)
    assert env.observation_space == Box(0, 255, (4, 84, 84), np.uint8)
    assert env.action_space == Discrete(18)


@pytest.mark.parametrize(
    ("setting", "value"),
    [
        ("img_width", 84),
        ("img_height", 84),
        ("grayscale", True),
        ("frame_skip", 4),
        ("stack_num", 4),
        ("full_action_space", True),
        ("episodic_life", False),
        ("reward_clipping", False),
        ("repeat_action_probability", 0.0),
    ],
)
def test_settings_are_those_of_table_3(setting: str, value: object) -> None:
    assert SETTINGS[setting] == value


def test_a_reward_is_the_points_of_four_frames_and_an_observation_their_last_two() -> None:
    """Against a plain emulator, frame by frame."""
    env = gymnasium.make(PACMAN).unwrapped
    observation, _ = env.reset(seed=3)
    console = ale_py.ALEInterface()
    console.setFloat("repeat_action_probability", 0.0)
    console.setInt("random_seed", int(env.emulators.arrays["seeds"][0]))
    console.loadROM(ale_py.roms.get_rom_path("ms_pacman"))
    console.reset_game()
    for _ in range(int(env.emulators.no_ops[0])):
        console.act(0)
    assert not observation[:3].any()  # older frames are black at the start
    rewards = 0.0
    for action in _actions(1, 120):
        before = observation
        observation, reward, terminated, truncated, _ = env.step(int(action[0]))
        frames, points = [], 0
        for _ in range(4):
            points += console.act(console.getLegalActionSet()[int(action[0])])
            frames.append(console.getScreenGrayscale())
        assert reward == points
        assert (terminated, truncated) == (False, False)
        np.testing.assert_array_equal(observation[:3], before[1:])
        newest = np.maximum(frames[-2], frames[-1])
        # 210 x 160 to 84 x 84 by area: two and a half rows, and 1.9 columns, for a pixel.
        assert abs(newest.mean() - observation[3].mean()) < 0.5
        rewards += reward
    assert rewards >= 10  # points, not signs


def test_only_the_last_lost_life_ends_an_episode() -> None:
    env = Emulators("ms_pacman", 1)
    env.restart(np.zeros(1, np.int64), [np.random.default_rng(0)])
    lives = []
    for _ in range(1000):
        _, terminated, infos = env._send(np.array([2]), np.zeros(1, np.bool_))
        lives.append(int(infos["lives"][0]))
        if terminated[0]:
            break
    assert sorted(set(lives)) == [0, 1, 2, 3]
    assert lives.index(0) == len(lives) - 1


def test_ten_thousand_steps_truncate() -> None:
    assert HORIZON == 10_000
    for envs in (_engine("SPRL/Freeway-v1", 1), _sync("SPRL/Freeway-v1", 1)):
        envs.reset(seed=0)
        emulators = envs._emulators if hasattr(envs, "_emulators") else envs.envs[0].unwrapped.emulators
        emulators.arrays["taken"][0] = HORIZON - 2
        if hasattr(envs, "_elapsed"):
            envs._elapsed[0] = HORIZON - 2
        flags = [envs.step(np.array([2]))[2:4] for _ in range(3)]
        assert [truncated.item() for _, truncated in flags] == [False, True, False]
        assert not any(terminated.item() for terminated, _ in flags)


def test_an_episode_begins_after_0_to_30_frames_without_an_action(short_blocks: None) -> None:
    env = Emulators("ms_pacman", 8)
    counts = []
    generators = [np.random.default_rng(row) for row in range(8)]
    for _ in range(4):
        env.restart(np.arange(8), generators)
        counts += env.no_ops.tolist()
    assert min(counts) >= 0
    assert max(counts) <= 30
    assert len(set(counts)) > 12


@pytest.mark.parametrize("steps", [250, pytest.param(10_000, marks=pytest.mark.slow)])
@pytest.mark.parametrize("env_id", IDS)
def test_it_is_ale_pys_own_vector_environment(env_id: str, steps: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """The same seeds and actions give the same arrays, over all episodes of a block."""
    monkeypatch.setattr(emulators_module, "BLOCK", 10**6)
    engine = _engine(env_id, 2, num_threads=1)
    mine, _ = engine.reset(seed=11)
    emulators = engine._emulators
    theirs = ale_py.AtariVectorEnv(
        emulators.game,
        2,
        autoreset_mode="SameStep",
        full_action_space=True,
        noop_max=31,
        reward_clipping=False,
        use_fire_reset=False,
    )
    observations, _ = theirs.reset(seed=emulators.arrays["seeds"].copy())
    np.testing.assert_array_equal(mine, observations)
    for actions in _actions(2, steps):
        for one, other in zip(engine.step(actions)[:4], theirs.step(actions)[:4], strict=True):
            np.testing.assert_array_equal(one, other)


# ------------------------------------------------------------------------------- engine and single


@pytest.mark.parametrize("mode", MODES)
def test_the_engine_equals_single_environments(mode: str, short_blocks: None) -> None:
    limits = {"max_episode_steps": 15}
    engine, single = _engine(PACMAN, 3, autoreset_mode=mode, **limits), _sync(PACMAN, 3, mode, **limits)
    _assert_equal(engine.reset(seed=5), single.reset(seed=5))
    for number, actions in enumerate(_actions(3, 100)):
        mine, theirs = engine.step(actions), single.step(actions)
        _assert_equal(mine, theirs)
        ended = mine[2] | mine[3]
        if mode == "Disabled" and ended.any():
            options = {"reset_mask": ended}
            _assert_equal(engine.reset(options=dict(options)), single.reset(options=dict(options)))
        elif number == 40:
            _assert_equal(engine.reset(), single.reset())
        elif number == 60:
            _assert_equal(engine.reset(seed=[7, None, 9]), single.reset(seed=[7, None, 9]))


def test_the_number_of_threads_changes_nothing() -> None:
    one, many = _engine(PACMAN, 3, num_threads=1), _engine(PACMAN, 3, num_threads=3)
    _assert_equal(one.reset(seed=1), many.reset(seed=1))
    for actions in _actions(3, 40):
        _assert_equal(one.step(actions), many.step(actions))


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("way", ["state", "deepcopy", "pickle"])
def test_a_state_continues_exactly(mode: str, way: str, short_blocks: None) -> None:
    limits = {"max_episode_steps": 17}
    engine = _engine(PACMAN, 2, autoreset_mode=mode, **limits)
    engine.reset(seed=2)

    def play(envs: Any, steps: int, seed: int) -> list[Any]:
        seen = []
        for actions in _actions(2, steps, seed):
            seen.append(envs.step(actions))
            ended = seen[-1][2] | seen[-1][3]
            if mode == "Disabled" and ended.any():
                seen.append(envs.reset(options={"reset_mask": ended}))
        return seen

    play(engine, 58, 0)
    if way == "state":
        other = _engine(PACMAN, 2, autoreset_mode=mode, **limits)
        other.reset(seed=99)
        other.set_state(engine.get_state())
    else:
        other = copy.deepcopy(engine) if way == "deepcopy" else pickle.loads(pickle.dumps(engine))
    _assert_equal(tuple(play(other, 60, 1)), tuple(play(engine, 60, 1)))


def test_a_single_environment_is_copied_exactly(short_blocks: None) -> None:
    env = gymnasium.make(PACMAN, max_episode_steps=20)
    env.reset(seed=4)
    for actions in _actions(1, 8):
        env.step(int(actions[0]))
    twin = pickle.loads(pickle.dumps(env.unwrapped))
    for actions in _actions(1, 10, 1):
        _assert_equal(twin.step(int(actions[0])), env.unwrapped.step(int(actions[0])))
    for _ in range(3):
        _assert_equal(twin.reset(), env.unwrapped.reset())


def test_sub_env_continues_the_game_and_its_stream(short_blocks: None) -> None:
    engine = _engine(PACMAN, 2, autoreset_mode="Disabled")
    engine.reset(seed=6)
    for actions in _actions(2, 12):
        engine.step(actions)
    single = engine.sub_env(1)
    for actions in _actions(2, 10, 1):
        observation, reward, *_ = single.step(int(actions[1]))
        observations, rewards, *_ = engine.step(actions)
        np.testing.assert_array_equal(observation, observations[1])
        assert reward == rewards[1]
    np.testing.assert_array_equal(single.reset()[0], engine.reset()[0][1])
    np.testing.assert_array_equal(single.reset()[0], engine.reset()[0][1])


def test_a_seed_determines_all_episodes(short_blocks: None) -> None:
    def starts(seed: int) -> list[bytes]:
        env = gymnasium.make(PACMAN)
        return [env.reset(seed=seed)[0].tobytes(), *(env.reset()[0].tobytes() for _ in range(5))]

    assert starts(1) == starts(1)
    assert starts(1) != starts(2)
    assert len(set(starts(1))) > 1


# --------------------------------------------------------------------------------- Gymnasium, errors


def test_gymnasiums_checker_finds_nothing() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(gymnasium.make(PACMAN, render_mode="rgb_array").unwrapped)


def test_spawned_workers_make_it() -> None:
    envs = AsyncVectorEnv([lambda: gymnasium.make(f"sprl_bench:{PACMAN}")], context="spawn")
    single = gymnasium.make(PACMAN)
    np.testing.assert_array_equal(envs.reset(seed=3)[0][0], single.reset(seed=3)[0])
    envs.close()


def test_the_screen_shows_the_present_in_colour() -> None:
    engine = _engine(PACMAN, 2, render_mode="rgb_array", max_episode_steps=20)
    engine.reset(seed=8)
    for actions in _actions(2, 25):
        engine.step(actions)
    before = engine.get_state()
    pictures = engine.render()
    _assert_equal(engine.get_state(), before)
    for row, picture in enumerate(pictures):
        assert picture.shape == (210, 160, 3)
        grey = picture @ np.array([0.299, 0.587, 0.114])
        # The newest processed frame has the maximum of two frames, of which the screen is the last.
        assert abs(grey.mean() - engine._observations[row, 3].mean()) < 3
        mine = grey.reshape(42, 5, 40, 4).mean(axis=(1, 3))
        seen = engine._observations[row, 3].reshape(42, 2, 84)[:, :, :80].reshape(42, 2, 40, 2).mean(axis=(1, 3))
        assert np.corrcoef(mine[:, :38].ravel(), seen[:, :38].ravel())[0, 1] > 0.3


@pytest.mark.parametrize("action", [-1, 18, 1.5, True, "up"])
def test_a_wrong_action_is_an_error_and_changes_nothing(action: Any) -> None:
    env = gymnasium.make(PACMAN, disable_env_checker=True).unwrapped
    env.reset(seed=0)
    with pytest.raises((TypeError, ValueError), match="action is"):
        env.step(action)
    assert env.emulators.arrays["taken"][0] == 0
    env.step(0)


def test_wrong_actions_of_the_engine_are_errors() -> None:
    engine = _engine(PACMAN, 2)
    engine.reset(seed=0)
    with pytest.raises(ValueError, match=r"actions\[1\] is 18; it must be an integer from 0 to 17\."):
        engine.step(np.array([0, 18]))
    with pytest.raises(TypeError, match="it must be integers of shape"):
        engine.step(np.array([0.0, 1.0]))


def test_a_step_needs_a_running_episode() -> None:
    env = gymnasium.make(PACMAN).unwrapped
    with pytest.raises(ResetNeeded):
        env.step(0)


def test_an_unknown_argument_is_an_error() -> None:
    with pytest.raises(TypeError, match="unexpected keyword argument 'frameskip'"):
        gymnasium.make(PACMAN, frameskip=2)


def test_without_the_extra_the_ids_are_there_and_make_says_what_to_install() -> None:
    code = (
        "import importlib.util, sys, gymnasium, sprl_bench\n"
        "from importlib.machinery import PathFinder\n"
        "find = PathFinder.find_spec\n"
        "PathFinder.find_spec = lambda name, *rest: None if name == 'ale_py' else find(name, *rest)\n"
        "for make in (gymnasium.make, gymnasium.make_vec):\n"
        "    try:\n"
        "        make('SPRL/Hero-v1')\n"
        "    except ImportError as error:\n"
        "        print(error)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    line = "The Atari games need ale_py: ale_py is not installed; install it with: pip install 'sprl-bench[atari]'."
    assert done.stdout.splitlines() == [line, line]


def test_a_state_out_of_range_is_refused() -> None:
    engine = _engine(PACMAN, 2)
    engine.reset(seed=0)
    state = engine.get_state()
    state["emulator_actions"][0, 0] = 18
    with pytest.raises(ValueError, match=r"emulator_actions.*must be from 0 to 17"):
        engine.set_state(state)
    with pytest.raises(ValueError, match="that of another task"):
        _engine("SPRL/Freeway-v1", 2).set_state(engine.get_state())


# ------------------------------------------------------------------------------------------- tasks


def test_every_game_is_a_task_and_has_published_references() -> None:
    for name, budget in (("atari", 12_000_000), ("atari-smoke", 20_000)):
        tasks = SUITES[name].tasks
        assert [task.env_id for task in tasks] == list(IDS)
        assert {task.budget for task in tasks} == {budget}
    assert set(REFERENCES) == set(IDS)
    for task in SUITES["atari"].tasks:
        low, high = task.score_range
        assert low <= REFERENCES[task.env_id][0] < REFERENCES[task.env_id][1] < high


def test_an_interrupted_run_resumes_exactly(tmp_path: Path) -> None:
    pytest.importorskip("torch")
    small = {"num_envs": 2, "rollout_length": 16, "epochs": 1, "minibatches": 1}
    (spec,) = expand(SUITES["atari-smoke"], ["ppo"], [0], tasks=["MsPacman"], budget=128, overrides=small, device="cpu")

    def lines(folder: Path) -> list[dict[str, Any]]:
        written = (spec.path(folder) / "metrics.jsonl").read_text().splitlines()
        return [{**json.loads(line), "wall_time_s": 0} for line in written]

    whole = run(spec, tmp_path / "whole")
    with pytest.raises(InterruptedRunError, match="continues from there"):
        run(spec, tmp_path / "halves", stop=lambda: True)
    halves = run(spec, tmp_path / "halves")
    assert lines(tmp_path / "halves") == lines(tmp_path / "whole")
    assert (halves.return_curve, halves.totals, halves.fingerprint) == (
        whole.return_curve,
        whole.totals,
        whole.fingerprint,
    )
