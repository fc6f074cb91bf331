"""Which task an environment is, and what may lie beneath the recorder."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium import wrappers
from gymnasium.vector import AsyncVectorEnv, SyncVectorEnv

from sprl_bench.recorder import identity
from sprl_bench.recorder.identity import Identity, choose_task, identify
from sprl_bench.tasks import Suite, Task

pytestmark = pytest.mark.usefixtures("fakes")

ID = "SPRL/FourRooms-7x7-v1"
FOUR_ROOMS = Identity(ID, {}, {})


def make(**arguments: Any) -> gymnasium.Env[Any, Any]:
    return gymnasium.make(ID, **arguments)


@pytest.fixture
def scripted_id() -> Iterator[str]:
    gymnasium.register(
        "Test/Scripted-v0", "harness_fakes:Scripted", kwargs={"episodes": [([1.0], True)]}, max_episode_steps=30
    )
    yield "Test/Scripted-v0"
    del gymnasium.registry["Test/Scripted-v0"]


@pytest.mark.parametrize(
    "env",
    [
        make,
        lambda: make(disable_env_checker=True),
        lambda: make(render_mode="rgb_array"),
        lambda: make(max_episode_steps=-1),
        lambda: make(render_mode="rgb_array_list"),
        lambda: gymnasium.make_vec(ID, 2),
        lambda: gymnasium.make_vec(ID, 2, autoreset_mode="NextStep", num_threads=1, render_mode="rgb_array"),
        lambda: gymnasium.make_vec(ID, 2, "sync"),
        lambda: SyncVectorEnv([make, make]),
        lambda: AsyncVectorEnv([make]),
    ],
)
def test_what_make_returns_is_known(env: Any) -> None:
    made = env()
    assert identify(made) == FOUR_ROOMS
    made.close()


class Shaped(gymnasium.RewardWrapper[Any, Any]):
    def reward(self, reward: Any) -> float:
        return float(reward) + 1.0


class Seen(gymnasium.vector.VectorWrapper):
    """A vector wrapper that does nothing."""


@pytest.mark.parametrize(
    ("env", "name"),
    [
        (lambda: Shaped(make()), "Shaped"),
        (lambda: wrappers.TransformObservation(Shaped(make()), lambda seen: seen, None), "TransformObservation"),
        (lambda: wrappers.RecordEpisodeStatistics(make()), "RecordEpisodeStatistics"),
        (lambda: wrappers.TimeLimit(make(), 50), "max_episode_steps=50"),
        (lambda: make(max_episode_steps=50), "max_episode_steps=50"),
        (lambda: gymnasium.make_vec(ID, 2, max_episode_steps=50), "max_episode_steps=50"),
        (lambda: gymnasium.make_vec(ID, 2, "sync", max_episode_steps=50), "max_episode_steps=50"),
        (lambda: gymnasium.make_vec(ID, 2, "sync", wrappers=[Shaped]), "Shaped"),
        (lambda: SyncVectorEnv([make, lambda: Shaped(make())]), "Shaped"),
        (lambda: AsyncVectorEnv([lambda: Shaped(make())]), "Shaped"),
        (lambda: AsyncVectorEnv([lambda: wrappers.TimeLimit(make(), 9)]), "max_episode_steps=9"),
        (lambda: Seen(gymnasium.make_vec(ID, 2)), "Seen"),
        (lambda: SyncVectorEnv([make, lambda: gymnasium.make("SPRL/KeyDoors-7x7-v1")]), "not all the same"),
        (lambda: type(make().unwrapped)(render_mode=None), "no registered id"),
        (lambda: gymnasium.make_vec(ID, 2).unwrapped.__class__(num_envs=2), "no registered id"),
    ],
)
def test_what_could_change_a_score_is_refused_by_name(env: Any, name: str) -> None:
    made = env()
    with pytest.raises(ValueError, match=name) as raised:
        identify(made)
    assert "\n" not in str(raised.value)
    made.close()


def test_other_kinds_of_environment_are_refused() -> None:
    from stable_baselines3.common.vec_env import DummyVecEnv

    with pytest.raises(TypeError, match=r"dummy_vec_env\.DummyVecEnv; record\(\) takes a gymnasium\.Env or"):
        identify(DummyVecEnv([make]))
    with pytest.raises(TypeError, match=r"builtins\.str"):
        identify(ID)


def test_the_time_limit_of_an_id_itself_is_part_of_it(scripted_id: str) -> None:
    assert identify(gymnasium.make(scripted_id)).env_id == scripted_id
    with pytest.raises(
        ValueError, match="max_episode_steps=10 changes where episodes of Test/Scripted-v0 end; it is 30"
    ):
        identify(gymnasium.make(scripted_id, max_episode_steps=10))


def test_a_vector_environment_says_when_it_resets() -> None:
    envs = gymnasium.make_vec(ID, 2)
    del envs.metadata["autoreset_mode"]
    with pytest.raises(ValueError, match="does not say when it resets"):
        identify(envs)


def test_an_argument_that_the_id_fixes_tells_two_tasks_apart() -> None:
    plain, smaller = (gymnasium.make("FrozenLake8x8-v1", **given) for given in ({}, {"map_name": "4x4"}))
    tasks = [choose_task(identify(env), None, 500)[1] for env in (plain, smaller)]
    assert [task.arguments for task in tasks] == [{}, {"map_name": "4x4"}]
    assert [task.name for task in tasks] == ["FrozenLake8x8-v1-500", "FrozenLake8x8-v1-map_name-4x4-500"]


def test_nothing_is_no_argument_of_a_record() -> None:
    """A record holds text, booleans and numbers; None is refused in a sentence unless it is the default."""
    with pytest.raises(ValueError, match="x is None; as an argument of Any-v0 in a record it must be text, a boolean"):
        choose_task(Identity("Any-v0", {"x": None}, {}), None, 500)


def test_another_value_of_an_argument_that_the_id_fixes_is_seen(scripted_id: str) -> None:
    other = gymnasium.make(scripted_id, episodes=[([9.0], True)])
    assert identify(other) != identify(gymnasium.make(scripted_id))


def test_a_wrapper_of_the_id_itself_is_part_of_it() -> None:
    own = (wrappers.TransformReward.wrapper_spec(func=np.sign),)
    gymnasium.register("Test/Wrapped-v0", "gymnasium.envs.classic_control:CartPoleEnv", additional_wrappers=own)
    try:
        assert identify(gymnasium.make("Test/Wrapped-v0")).env_id == "Test/Wrapped-v0"
        with pytest.raises(ValueError, match="ClipReward"):
            identify(wrappers.ClipReward(gymnasium.make("Test/Wrapped-v0"), 0, 1))
    finally:
        del gymnasium.registry["Test/Wrapped-v0"]


@pytest.mark.parametrize("explicit", [{}, {"substep": 20}])
@pytest.mark.parametrize("declared", [{}, {"substep": 20}])
def test_a_default_given_explicitly_changes_nothing(
    scripted_id: str, explicit: dict[str, Any], declared: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    task = Task("Scripted", scripted_id, 100, "test", declared)
    monkeypatch.setattr(identity, "SUITES", {"tests": Suite("tests", 3, (task,))})
    known = identify(gymnasium.make(scripted_id, **explicit))
    assert choose_task(known, None, None)[1] is task
    other = identify(gymnasium.make(scripted_id, substep=3))
    with pytest.raises(ValueError, match=r"No suite has a task Test/Scripted-v0, substep=3:"):
        choose_task(other, None, None)


def test_a_default_given_explicitly_makes_no_task_of_its_own() -> None:
    reach = {"terminate_on_goal": True, "substep": 20}
    tasks = [
        choose_task(Identity("SPRL/FetchReachSparse-v1", arguments, reach), None, 500)[1]
        for arguments in ({"substep": 100}, {"substep": 100, "terminate_on_goal": True})
    ]
    assert tasks[0] == tasks[1]


def test_what_only_shows_our_tasks_may_change_those_of_others(scripted_id: str) -> None:
    spec = gymnasium.registry[scripted_id]
    for name in ("observation", "copy"):
        assert identity._identity(spec, {name: "pixels"}).arguments == {name: "pixels"}
        assert identity._identity(gymnasium.registry[ID], {name: "pixels"}).arguments == {}


def test_the_first_suite_is_taken_or_the_one_that_is_named() -> None:
    suite, task = choose_task(FOUR_ROOMS, None, None)
    assert (suite.name, task.name, task.budget) == ("grid", "FourRooms-7x7", 500_000)
    suite, task = choose_task(FOUR_ROOMS, "smoke", None)
    assert (suite.name, suite.version, task.budget) == ("smoke", 2, 100_000)
    assert choose_task(FOUR_ROOMS, "smoke", 100_000)[0].name == "smoke"


@pytest.mark.parametrize("suite", [None, "smoke", "custom"])
def test_another_budget_is_no_score_of_a_suite(suite: str | None) -> None:
    chosen, task = choose_task(FOUR_ROOMS, suite, 1000)
    assert (chosen.name, chosen.version) == ("custom", 0)
    assert (task.name, task.budget, task.domain, task.env_id) == ("FourRooms-7x7-1000", 1000, "grid", ID)


def test_a_task_of_no_suite_needs_a_budget_and_says_in_its_name_what_it_is() -> None:
    cart_pole = identify(gymnasium.make("CartPole-v1", sutton_barto_reward=True))
    with pytest.raises(ValueError, match=r"No suite has a task CartPole-v1, sutton_barto_reward=True: .*budget="):
        choose_task(cart_pole, None, None)
    suite, task = choose_task(cart_pole, None, 500)
    assert (suite.name, task.name, task.budget) == ("custom", "CartPole-v1-sutton_barto_reward-True-500", 500)
    assert task.arguments == {"sutton_barto_reward": True}


@pytest.mark.parametrize(
    ("suite", "budget", "message"),
    [
        ("grit", None, "Unknown suite 'grit'; did you mean 'grid'"),
        ("smoke", 0, "budget is 0; it must be a positive integer"),
        ("smoke", True, "budget is True"),
        ("smoke", 1e4, "budget is 10000.0"),
    ],
)
def test_bad_choices_are_named(suite: str, budget: Any, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        choose_task(FOUR_ROOMS, suite, budget)


@pytest.mark.parametrize("score_range", [5, (0,), (1, 0), (0, float("nan")), "ab"])
def test_a_range_is_two_numbers_in_order(score_range: Any) -> None:
    with pytest.raises(ValueError, match=r"^score_range is .*; it must be two numbers, the lowest and the highest"):
        choose_task(Identity("Any-v0", {}, {}), None, 500, score_range)


def test_a_suite_without_the_task_says_which_it_has() -> None:
    with pytest.raises(ValueError, match="suite 'smoke' has no task SPRL/KeyDoors-7x7-v1; its tasks are FourRooms-7x7"):
        choose_task(Identity("SPRL/KeyDoors-7x7-v1", {}, {}), "smoke", 100)
