"""The check of a batch of discrete actions."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sprl_bench.envs.discrete_actions import DiscreteActions

NONE_SKIPPED = np.zeros(2, np.bool_)


@pytest.mark.parametrize("dtype", [np.int8, np.uint8, np.int32, np.int64, np.uint64])
def test_actions_of_any_integer_type_become_int64(dtype: type[np.integer]) -> None:
    checked = DiscreteActions(2, 5).checked(np.array([5, 0], dtype), NONE_SKIPPED)
    assert checked.dtype == np.int64
    assert checked.tolist() == [5, 0]


def test_a_list_is_taken_too() -> None:
    assert DiscreteActions(2, 5).checked([1, 2], NONE_SKIPPED).tolist() == [1, 2]


@pytest.mark.parametrize("actions", [[0.0, 1.0], [True, False], [1], [[1, 2]], 3, None])
def test_other_types_and_shapes_are_refused(actions: object) -> None:
    with pytest.raises(TypeError, match=r"actions is .*; it must be integers of shape \(2,\)\."):
        DiscreteActions(2, 5).checked(actions, NONE_SKIPPED)


@given(
    st.lists(st.tuples(st.integers(-3, 9), st.booleans()), min_size=1, max_size=5),
    st.integers(0, 6),
)
@settings(max_examples=200, deadline=None)
def test_the_first_action_out_of_range_that_counts_is_named(rows: list[tuple[int, bool]], highest: int) -> None:
    actions = [action for action, _ in rows]
    skipped = np.array([is_skipped for _, is_skipped in rows])
    wrong = [row for row, (action, is_skipped) in enumerate(rows) if not 0 <= action <= highest and not is_skipped]
    check = DiscreteActions(len(rows), highest)
    if not wrong:
        assert check.checked(actions, skipped).tolist() == actions
        return
    expected = rf"actions\[{wrong[0]}\] is {actions[wrong[0]]}; it must be an integer from 0 to {highest}\."
    with pytest.raises(ValueError, match=expected):
        check.checked(actions, skipped)
