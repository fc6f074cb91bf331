"""The forms of a grid observation: the same information, the same episodes, the same bits alone and in batches."""

from __future__ import annotations

from pathlib import Path

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env, data_equivalence
from gymnasium.vector import SyncVectorEnv

import sprl_bench
from sprl_bench.envs import GRID_IDS
from sprl_bench.envs.grid import Action
from sprl_bench.envs.grid.observations import FORMS, THINGS
from sprl_bench.records import find_records

KEY_DOORS = "SPRL/KeyDoors-7x7-v1"


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("env_id", GRID_IDS)
@pytest.mark.parametrize("mode", ["SameStep", "NextStep"])
def test_the_engine_gives_the_bits_of_the_single_environments(env_id: str, form: str, mode: str) -> None:
    ours = gymnasium.make_vec(env_id, num_envs=5, observation=form, autoreset_mode=mode)
    theirs = SyncVectorEnv([lambda: gymnasium.make(env_id, observation=form)] * 5, autoreset_mode=mode)
    assert ours.observation_space == theirs.observation_space
    assert data_equivalence(ours.reset(seed=3), theirs.reset(seed=3), exact=True)
    actions = np.random.default_rng(0).integers(7, size=(230, 5))
    for action in actions:
        assert data_equivalence(ours.step(action), theirs.step(action), exact=True)


def test_the_forms_show_the_same_episodes() -> None:
    cells, flat, one_hot = (gymnasium.make_vec(KEY_DOORS, num_envs=4, observation=form) for form in FORMS)
    seen = [envs.reset(seed=1)[0] for envs in (cells, flat, one_hot)]
    for action in np.random.default_rng(1).integers(7, size=(150, 4)):
        numbers = seen[2].reshape(4, 7, 7, len(THINGS)).argmax(-1)
        assert (seen[0].reshape(4, -1) == seen[1]).all()
        assert (np.array(THINGS)[numbers] == seen[0][..., [0, 2]]).all()
        assert (seen[2].reshape(4, 49, -1).sum(-1) == 1).all()
        steps = [envs.step(action) for envs in (cells, flat, one_hot)]
        assert all((step[1] == steps[0][1]).all() for step in steps)
        seen = [step[0] for step in steps]


@pytest.mark.parametrize("form", FORMS)
def test_gymnasiums_checker_accepts_each_form(form: str) -> None:
    check_env(gymnasium.make(KEY_DOORS, observation=form).unwrapped, skip_render_check=True)


def test_a_state_fits_every_form() -> None:
    flat = gymnasium.make_vec(KEY_DOORS, num_envs=2, observation="flat")
    cells = gymnasium.make_vec(KEY_DOORS, num_envs=2)
    flat.reset(seed=5)
    cells.reset(seed=6)
    cells.unwrapped.set_state(flat.unwrapped.get_state())
    action = np.array([Action.FORWARD, Action.LEFT])
    assert (cells.step(action)[0].reshape(2, -1) == flat.step(action)[0]).all()


@pytest.mark.parametrize("make", [gymnasium.make, gymnasium.make_vec])
def test_an_unknown_form_is_refused(make: object) -> None:
    with pytest.raises(ValueError, match=r"observation is 'onehot'; it must be one of .* Did you mean 'one-hot'"):
        make(KEY_DOORS, observation="onehot")


def test_actions_have_names() -> None:
    env = gymnasium.make(KEY_DOORS)
    env.reset(seed=0)
    before = env.unwrapped.agent_dir
    env.step(Action.RIGHT)
    assert env.unwrapped.agent_dir == (before + 1) % 4
    assert [action.value for action in Action] == list(range(env.action_space.n))


@pytest.mark.parametrize("make", [gymnasium.make, gymnasium.make_vec])
@pytest.mark.parametrize("env_id", ["SPRL/FourRooms-7x7-v1", "SPRL/MazeGoalSmall-v1"])
def test_an_unknown_argument_is_refused_in_pythons_words(make: object, env_id: str) -> None:
    """TorchRL's `GymEnv` passes `frameskip` and tries again without it after these words."""
    with pytest.raises(TypeError, match="got an unexpected keyword argument 'frameskip'"):
        make(env_id, frameskip=1)


@pytest.mark.parametrize("mode", ["SameStep", "NextStep", "Disabled"])
def test_the_autoreset_mode_has_the_name_of_sync_vector_env(mode: str, tmp_path: Path) -> None:
    """TorchRL's `GymWrapper` reads it, recorded or not."""
    envs = gymnasium.make_vec(KEY_DOORS, num_envs=2, autoreset_mode=mode)
    reference = SyncVectorEnv([lambda: gymnasium.make(KEY_DOORS)], autoreset_mode=mode)
    recorded = sprl_bench.record(envs, out=tmp_path, agent="mine", seed=0)
    assert envs.autoreset_mode == recorded.autoreset_mode == reference.autoreset_mode
    recorded.close()


@pytest.mark.parametrize("form", FORMS[1:])
def test_task_and_score_do_not_depend_on_the_form(form: str, tmp_path: Path) -> None:
    """The same actions give the same record of the same task, whatever the agent sees."""
    scores = []
    for name in ("cells", form):
        envs = gymnasium.make_vec("SPRL/FourRooms-7x7-v1", num_envs=4, observation=name)
        envs = sprl_bench.record(envs, out=tmp_path / name, agent="walker", seed=0, budget=3_000)
        envs.reset(seed=0)
        for action in np.random.default_rng(0).integers(3, size=(750, 4)):
            envs.step(action)
        envs.close()
        [record] = find_records(tmp_path / name)
        assert record.spec.task.name == "FourRooms-7x7-3000"
        assert record.spec.observation == ("" if name == "cells" else name)
        scores.append((record.scores, record.fingerprint, record.totals.episodes))
    assert scores[0] == scores[1]
    assert scores[0][2] > 20
