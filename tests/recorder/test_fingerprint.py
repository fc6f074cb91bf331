"""The fingerprint tells revisions of an environment apart, and nothing else."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import gymnasium
import numpy as np
import pytest

from sprl_bench.envs import FETCH_IDS, GRID_IDS, IDS
from sprl_bench.recorder import fingerprint as module
from sprl_bench.recorder.fingerprint import fingerprint
from sprl_bench.records import TaskSpec
from sprl_bench.tasks import SUITES, Task

# Every environment, the longest horizon, and the strongest noise.
TASKS = [
    *(task for name in ("grid", "fetch", "fetch-sparse", "maze") for task in SUITES[name].tasks),
    SUITES["sparsity"].tasks[0],
    *SUITES["noise"].tasks[-4:],
]


class Lamp(gymnasium.Env[Any, Any]):
    """Shows a noisy number and pays for action 1; every fifth step is the last."""

    observation_space = gymnasium.spaces.Dict({"light": gymnasium.spaces.Box(-9, 9, (1,), np.float64)})
    action_space = gymnasium.spaces.Discrete(3)
    scale, reward, horizon, success, shift = 1.0, 1.0, 5, True, 0.0

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> Any:
        super().reset(seed=seed)
        self._time = 0
        return self._look(), {"is_success": False}

    def _look(self) -> dict[str, Any]:
        return {"light": self.np_random.uniform(-1, 1, 1) * self.scale + self.shift}

    def step(self, action: int) -> Any:
        self._time += 1
        ended = self._time == self.horizon
        return self._look(), self.reward * float(action == 1), ended, False, {"is_success": ended and self.success}


@pytest.fixture(autouse=True)
def forget() -> Iterator[None]:
    """Let no test of this file or of another see the fingerprint of an environment that was changed for one."""
    yield
    module._fingerprint.cache_clear()


@pytest.fixture
def lamp() -> Iterator[str]:
    gymnasium.register("Test/Lamp-v0", Lamp, disable_env_checker=True)
    yield "Test/Lamp-v0"
    del gymnasium.registry["Test/Lamp-v0"]


def of(env_id: str, **arguments: Any) -> str:
    module._fingerprint.cache_clear()
    return fingerprint(TaskSpec(name="task", env_id=env_id, budget=1, domain="test", arguments=arguments))


def test_ids_have_different_fingerprints_that_stay_the_same() -> None:
    first = [of(env_id) for env_id in IDS]
    assert len(set(first)) == len(IDS)
    assert [of(IDS[0]), of(IDS[-1])] == [first[0], first[-1]]
    assert all(len(value) == 16 for value in first)


@pytest.mark.parametrize("task", TASKS, ids=lambda task: task.name)
def test_it_sees_a_reward_and_both_endings(task: Task) -> None:
    mode = {"autoreset_mode": gymnasium.vector.AutoresetMode.SAME_STEP}
    envs = gymnasium.make_vec(task.env_id, 2, vectorization_mode="sync", vector_kwargs=mode, **task.arguments)
    steps = [seen for seen in module.trajectory(envs, task.env_id) if len(seen) > 1]
    rewards, terminated, truncated = (np.array([seen[field] for seen in steps]) for field in (1, 2, 3))
    assert (rewards > 0).any()
    assert terminated.any() == (task.domain != "dmlab")  # mazes never terminate
    assert truncated.any()
    if task.domain == "dmlab":
        assert (rewards[-1] > 0).all()
    elif task.domain == "grid":
        assert terminated[-1].all()  # both golden episodes end at the goal
    else:
        assert rewards[-1].tolist() == [1.0, 0.0]  # one begins within reach, one just beyond


@pytest.mark.parametrize("env_id", [*GRID_IDS, *FETCH_IDS])  # random play of a game may never be paid
def test_another_reward_at_the_goal_changes_it(env_id: str, monkeypatch: pytest.MonkeyPatch) -> None:
    before = of(env_id)
    kind = type(gymnasium.make(env_id).unwrapped)
    step = kind.step

    def generous(self: Any, action: Any) -> Any:
        observation, reward, *rest = step(self, action)
        return observation, reward * 1.01, *rest

    monkeypatch.setattr(kind, "step", generous)
    assert of(env_id) != before


def test_an_episode_that_never_ends_does_not_hold_it_up(lamp: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Lamp, "horizon", -1)
    mode = {"autoreset_mode": gymnasium.vector.AutoresetMode.SAME_STEP}
    envs = gymnasium.make_vec(lamp, 2, vectorization_mode="sync", vector_kwargs=mode)
    assert sum(1 for _ in module.trajectory(envs, lamp)) == 1 + module.MOST_STEPS


def test_arguments_belong_to_it() -> None:
    assert of("CartPole-v1") != of("CartPole-v1", sutton_barto_reward=True)


@pytest.mark.parametrize(
    ("name", "value"), [("scale", 1.01), ("reward", 0.9), ("horizon", 6), ("success", False), ("shift", 0.1)]
)
def test_any_change_that_an_agent_could_see_changes_it(
    lamp: str, name: str, value: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = of(lamp)
    assert of(lamp) == before
    monkeypatch.setattr(Lamp, name, value)
    assert of(lamp) != before


def test_the_last_bits_of_a_simulator_do_not(lamp: str, monkeypatch: pytest.MonkeyPatch) -> None:
    before = of(lamp)
    monkeypatch.setattr(Lamp, "shift", 1e-13)
    assert of(lamp) == before


@pytest.mark.parametrize("task", [*SUITES["fetch"].tasks, SUITES["fetch-sparse"].tasks[2]], ids=lambda task: task.name)
def test_contact_does_not_make_the_last_bits_matter(task: Task, monkeypatch: pytest.MonkeyPatch) -> None:
    before = of(task.env_id, **task.arguments)
    kind = type(gymnasium.make(task.env_id).unwrapped)
    reset = kind.reset

    for joint in (0, 7, -7):

        def nudged(
            self: Any, *, seed: int | None = None, options: dict[str, Any] | None = None, joint: int = joint
        ) -> Any:
            seen = reset(self, seed=seed, options=options)
            position = self.simulation.data.qpos
            position[joint] = np.nextafter(position[joint], np.inf)
            return seen

        monkeypatch.setattr(kind, "reset", nudged)
        assert of(task.env_id, **task.arguments) == before


def test_it_is_computed_once_a_process(lamp: str, monkeypatch: pytest.MonkeyPatch) -> None:
    spec = TaskSpec(name="task", env_id=lamp, budget=1, domain="test")
    first = fingerprint(spec)
    monkeypatch.setattr(Lamp, "scale", 2.0)
    assert fingerprint(spec) == first


def test_it_leaves_the_global_streams_alone() -> None:
    state = np.random.get_state()[1].tolist()  # noqa: NPY002 - the very thing that must not move
    of(IDS[0])
    assert np.random.get_state()[1].tolist() == state  # noqa: NPY002
