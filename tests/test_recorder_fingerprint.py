"""The fingerprint tells revisions of an environment apart, and nothing else."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import gymnasium
import numpy as np
import pytest

from sprl_bench.envs import IDS
from sprl_bench.recorder import fingerprint as module
from sprl_bench.recorder.fingerprint import fingerprint
from sprl_bench.records import TaskSpec


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


@pytest.fixture
def lamp() -> Iterator[str]:
    gymnasium.register("Test/Lamp-v0", Lamp, disable_env_checker=True)
    module._fingerprint.cache_clear()
    yield "Test/Lamp-v0"
    del gymnasium.registry["Test/Lamp-v0"]


def of(env_id: str, **arguments: Any) -> str:
    module._fingerprint.cache_clear()
    return fingerprint(TaskSpec(name="task", env_id=env_id, budget=1, domain="test", arguments=arguments))


def test_ids_have_different_fingerprints_that_stay_the_same() -> None:
    first = [of(env_id) for env_id in IDS]
    assert len(set(first)) == len(IDS)
    assert [of(env_id) for env_id in IDS] == first
    assert all(len(value) == 16 for value in first)


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


def test_it_is_computed_once_a_process(lamp: str, monkeypatch: pytest.MonkeyPatch) -> None:
    spec = TaskSpec(name="task", env_id=lamp, budget=1, domain="test")
    first = fingerprint(spec)
    monkeypatch.setattr(Lamp, "scale", 2.0)
    assert fingerprint(spec) == first


def test_it_leaves_the_global_streams_alone() -> None:
    state = np.random.get_state()[1].tolist()  # noqa: NPY002 - the very thing that must not move
    of(IDS[0])
    assert np.random.get_state()[1].tolist() == state  # noqa: NPY002
