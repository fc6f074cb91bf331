"""Hyperparameters: what is accepted, and the one sentence that answers everything else."""

from __future__ import annotations

import json
import math
import re
from dataclasses import FrozenInstanceError, dataclass
from typing import Annotated, Any

import pytest

from sprl_baselines.learning.config import Choice, Config, Count, Positive, Range, Share, reject_unknown
from sprl_baselines.ppo import PPOConfig


@dataclass(frozen=True)
class Example(Config):
    """One field of each kind."""

    steps: Count = 2
    rate: Positive = 0.5
    share: Share = 1.0
    switch: bool = False
    word: Annotated[str, Choice("one", "two")] = "one"
    free: float = -1.0


def test_defaults_and_allowed_values() -> None:
    assert Example().as_dict() == {
        "steps": 2,
        "rate": 0.5,
        "share": 1.0,
        "switch": False,
        "word": "one",
        "free": -1.0,
    }
    assert Example(steps=1, rate=1e-9, share=0.0, switch=True, word="two", free=-1e300).steps == 1


def test_whole_numbers_become_floats_where_floats_are_meant() -> None:
    assert [type(value) for value in (Example(rate=1).rate, Example(share=0).share)] == [float, float]


@pytest.mark.parametrize(
    ("field", "value", "allowed"),
    [
        ("steps", 0, "a whole number, at least 1"),
        ("steps", 1.0, "a whole number, at least 1"),
        ("steps", True, "a whole number, at least 1"),
        ("steps", "3", "a whole number, at least 1"),
        ("steps", None, "a whole number, at least 1"),
        ("rate", 0.0, "a finite number, above 0"),
        ("rate", True, "a finite number, above 0"),
        ("rate", math.nan, "a finite number, above 0"),
        ("rate", math.inf, "a finite number, above 0"),
        ("rate", 10**400, "a finite number, above 0"),
        ("rate", "0.1", "a finite number, above 0"),
        ("share", 1.5, "a finite number, at least 0 and at most 1"),
        ("share", -0.1, "a finite number, at least 0 and at most 1"),
        ("free", math.nan, "a finite number"),
        ("switch", 1, "true or false"),
        ("switch", "false", "true or false"),
        ("word", "three", "text, one of 'one', 'two'"),
        ("word", 1, "text, one of 'one', 'two'"),
    ],
)
def test_a_wrong_value_is_one_sentence(field: str, value: Any, allowed: str) -> None:
    with pytest.raises(
        ValueError, match=f"^{re.escape(f'Hyperparameter {field} is {value!r}; it must be {allowed}.')}$"
    ):
        Example(**{field: value})


def test_an_unknown_name_is_answered_with_the_nearest() -> None:
    with pytest.raises(ValueError, match=r"Unknown hyperparameter 'step'; did you mean 'steps'\?"):
        reject_unknown("hyperparameter", {"rate": 1, "step": 2}, Example.names())


def test_picking_takes_its_own_and_leaves_the_rest() -> None:
    assert Example.pick({"steps": 5, "other": 1}) == Example(steps=5)


def test_configs_cannot_be_changed() -> None:
    with pytest.raises(FrozenInstanceError):
        Example().steps = 3  # type: ignore[misc]


def test_ranges_say_what_they_hold() -> None:
    assert 0 not in Range(0, open_low=True)
    assert 0 in Range(0, 1)
    assert 1 in Range(0, 1)
    assert str(Range(0.5)) == "at least 0.5"
    assert str(Range(0, 2, open_low=True)) == "above 0 and at most 2"


def test_the_defaults_of_ppo_are_table_1s_and_go_through_json() -> None:
    config = PPOConfig()
    assert (config.learning_rate, config.entropy_coefficient) == (0.003, 0.01)
    assert (config.num_envs, config.epochs, config.minibatches) == (12, 4, 4)
    assert (config.gamma, config.gae_lambda, config.bootstrap_on_truncation) == (0.99, 0.95, False)
    assert PPOConfig(**json.loads(json.dumps(config.as_dict()))) == config


def test_more_minibatches_than_samples_are_refused() -> None:
    PPOConfig(num_envs=2, rollout_length=3, minibatches=6)
    with pytest.raises(ValueError, match=r"minibatches is 7; it must be at most num_envs \* rollout_length, 6"):
        PPOConfig(num_envs=2, rollout_length=3, minibatches=7)
