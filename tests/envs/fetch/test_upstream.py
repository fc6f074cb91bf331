"""The single environments beside Gymnasium-Robotics' own: the same numbers, bit for bit, on the same MuJoCo.

Where Gymnasium-Robotics is broken (MuJoCo 3.12 and later) its four joint functions are mended for these tests alone,
in a way that shares nothing with ours. `make test-upstream` runs this file where nothing needs mending.
"""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
import pytest

import sprl_bench.envs

mujoco = pytest.importorskip("mujoco")
gymnasium_robotics = pytest.importorskip("gymnasium_robotics")

from gymnasium_robotics.utils import mujoco_utils  # noqa: E402

from sprl_bench.envs.fetch import upstream  # noqa: E402

sprl_bench.envs.register()
gymnasium.register_envs(gymnasium_robotics)

TASKS = ("Reach", "Push", "Slide", "PickAndPlace")
JOINT_FUNCTIONS = ("get_joint_qpos", "get_joint_qvel", "set_joint_qpos", "set_joint_qvel")
IS_BROKEN = tuple(int(part) for part in mujoco.__version__.split(".")[:2]) >= (3, 12)


def _assign(attribute: str) -> Any:
    def assign(model: Any, data: Any, name: str, value: Any) -> None:
        getattr(data.joint(name), attribute)[:] = value

    return assign


@pytest.fixture
def reference(monkeypatch: pytest.MonkeyPatch) -> None:
    upstream.joint_utils()  # ours are mended, once and for all, before upstream's are
    if IS_BROKEN:
        for attribute in ("qpos", "qvel"):
            get = lambda model, data, name, attribute=attribute: getattr(data.joint(name), attribute).copy()  # noqa: E731
            monkeypatch.setattr(mujoco_utils, f"get_joint_{attribute}", get)
            monkeypatch.setattr(mujoco_utils, f"set_joint_{attribute}", _assign(attribute))


def steered(observation: dict[str, np.ndarray], rng: np.random.Generator, clock: int) -> np.ndarray:
    """Return an action: now at random, now towards the object and the goal, with a closing grip."""
    if (clock // 5) % 4 == 3:
        return rng.uniform(-1.2, 1.2, 4)
    grip, thing, goal = observation["observation"][:3], observation["achieved_goal"], observation["desired_goal"]
    aim = goal if len(observation["observation"]) == 10 or np.linalg.norm(thing - grip) < 0.03 else thing
    return np.append(10 * (aim - grip), 1.0 if np.linalg.norm(thing - grip) > 0.03 else -1.0)


@pytest.mark.parametrize("seeds", [range(3), pytest.param(range(3, 20), marks=pytest.mark.slow)])
@pytest.mark.parametrize("task", TASKS)
def test_neutral_arguments_equal_upstream_bit_for_bit(task: str, seeds: range, reference: None) -> None:
    ours = gymnasium.make(f"SPRL/Fetch{task}Sparse-v1", terminate_on_goal=False, observation="goal")
    theirs = gymnasium.make(f"Fetch{task}-v4", max_episode_steps=50)
    assert ours.action_space == theirs.action_space
    assert ours.observation_space == theirs.observation_space
    rng = np.random.default_rng(0)
    successes = 0
    for seed in seeds:
        mine, info = ours.reset(seed=seed)
        yours, _ = theirs.reset(seed=seed)
        for clock in range(200):
            for name, values in yours.items():
                assert mine[name].dtype == values.dtype
                assert np.array_equal(mine[name], values), (seed, clock, name)
            action = steered(mine, rng, clock).astype(np.float32)
            mine, reward, terminated, truncated, info = ours.step(action)
            yours, price, ending, cut, report = theirs.step(action)
            assert (reward, terminated, truncated) == (price + 1, ending, cut)
            assert info["is_success"] == bool(report["is_success"])
            successes += info["is_success"]
            if truncated:
                mine, info = ours.reset()
                yours, _ = theirs.reset()
    assert successes > 0 or task != "Reach"  # the others are too hard to be solved by chance: see the next test
    ours.close()
    theirs.close()


@pytest.mark.parametrize("task", TASKS)
def test_success_equals_upstream_where_the_goal_is_put_on_what_must_reach_it(task: str, reference: None) -> None:
    ours = gymnasium.make(f"SPRL/Fetch{task}Sparse-v1", terminate_on_goal=False, observation="goal")
    theirs = gymnasium.make(f"Fetch{task}-v4")
    mine, _ = ours.reset(seed=0)
    theirs.reset(seed=0)
    ours.unwrapped.simulation.goal = mine["achieved_goal"].copy()
    theirs.unwrapped.goal = mine["achieved_goal"].copy()
    _, reward, *_, info = ours.step(np.zeros(4, np.float32))
    _, price, *_, report = theirs.step(np.zeros(4, np.float32))
    assert (reward, info["is_success"]) == (1.0, True)
    assert (price, report["is_success"]) == (0.0, 1.0)


@pytest.mark.parametrize("task", TASKS)
def test_the_flat_observation_is_upstreams_three_parts_in_order(task: str, reference: None) -> None:
    ours = gymnasium.make(f"SPRL/Fetch{task}Sparse-v1", terminate_on_goal=False)
    theirs = gymnasium.make(f"Fetch{task}-v4")
    mine, _ = ours.reset(seed=5)
    yours, _ = theirs.reset(seed=5)
    for action in np.random.default_rng(0).uniform(-1, 1, (20, 4)).astype(np.float32):
        parts = [yours[name] for name in ("observation", "achieved_goal", "desired_goal")]
        assert mine.dtype == np.float64
        assert np.array_equal(mine, np.concatenate(parts))
        mine, yours = ours.step(action)[0], theirs.step(action)[0]


@pytest.mark.skipif(not IS_BROKEN, reason="this MuJoCo works with upstream as it is")
def test_upstreams_own_environments_stay_as_they_are() -> None:
    before = {name: getattr(mujoco_utils, name) for name in JOINT_FUNCTIONS}
    ours = gymnasium.make("SPRL/FetchReachSparse-v1")
    ours.reset(seed=0)
    assert before == {name: getattr(mujoco_utils, name) for name in JOINT_FUNCTIONS}
    assert mujoco_utils.mujoco is mujoco
    assert upstream.is_broken()
    with pytest.raises(AssertionError):
        gymnasium.make("FetchReach-v4")


@pytest.mark.skipif(not IS_BROKEN, reason="this MuJoCo works with upstream as it is")
def test_a_broken_upstream_is_mended_in_a_copy() -> None:
    assert upstream.joint_utils() is not mujoco_utils
    assert not upstream.is_broken(upstream.joint_utils())


def test_an_upstream_that_works_is_used_as_it_is(reference: None) -> None:
    assert not upstream.is_broken()
    assert upstream.joint_utils.__wrapped__() is mujoco_utils


@pytest.mark.skipif(not IS_BROKEN, reason="this MuJoCo works with upstream as it is")
@pytest.mark.parametrize("kind", ["hinge", "slide", "ball", "free"])
def test_the_mended_functions_read_and_write_every_kind_of_joint_that_upstream_can(kind: str) -> None:
    joint = "<freejoint name='it'/>" if kind == "free" else f"<joint name='it' type='{kind}'/>"
    xml = f"<mujoco><worldbody><body>{joint}<geom size='1'/></body></worldbody></mujoco>"
    model = mujoco.MjModel.from_xml_string(xml)
    data = mujoco.MjData(model)
    utils = upstream.joint_utils()
    value = np.arange(1.0, model.nq + 1)
    utils.set_joint_qpos(model, data, "it", value if model.nq > 1 else value[0])
    assert np.array_equal(utils.get_joint_qpos(model, data, "it"), value)
    assert np.array_equal(data.qpos, value)


def test_the_flat_environment_is_no_goal_environment() -> None:
    from gymnasium_robotics.core import GoalEnv

    kinds = {name: gymnasium.make("SPRL/FetchPushSparse-v1", observation=name).unwrapped for name in ("flat", "goal")}
    assert not isinstance(kinds["flat"], GoalEnv)
    assert not hasattr(kinds["flat"], "compute_reward")
    assert isinstance(kinds["goal"], GoalEnv)


@pytest.mark.parametrize("substep", [1, 3, 500])
@pytest.mark.parametrize("task", TASKS)
def test_the_start_does_not_depend_on_the_substep(task: str, substep: int) -> None:
    ours, neutral = (gymnasium.make(f"SPRL/Fetch{task}Sparse-v1", substep=number) for number in (substep, 20))
    for seed in (3, None, None):
        start, expected = ours.reset(seed=seed)[0], neutral.reset(seed=seed)[0]
        assert np.array_equal(start, expected)
        ours.step(np.ones(4))


def test_velocities_are_in_the_unit_of_the_reference_substep() -> None:
    """With one substep a velocity times 25 a second is the speed of the gripper, as it is with 20."""
    env = gymnasium.make("SPRL/FetchReachSparse-v1", substep=1, observation="goal", terminate_on_goal=False)
    before = env.reset(seed=0)[0]["observation"][:3]
    for _ in range(30):
        after = env.step(np.array([1.0, 0.0, 0.0, 0.0]))[0]["observation"]
        moved, before = after[:3] - before, after[:3]
    assert after[5] * 25 == pytest.approx(moved[0] / 0.002, rel=0.05)
    assert moved[0] > 1e-5
