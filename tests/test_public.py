"""What the package shows: a short, sorted list of names, each of which is there."""

from __future__ import annotations

import sprl_bench


def test_every_public_name_is_there_and_has_a_docstring() -> None:
    for name in sprl_bench.__all__:
        assert name == "SUITES" or getattr(sprl_bench, name).__doc__, name


def test_the_list_of_names_is_sorted_and_short() -> None:
    constants, classes, functions = (
        [name for name in sprl_bench.__all__ if name.isupper()],
        [name for name in sprl_bench.__all__ if name[0].isupper() and not name.isupper()],
        [name for name in sprl_bench.__all__ if name.islower()],
    )
    assert sprl_bench.__all__ == sorted(constants) + sorted(classes) + sorted(functions)
    assert len(sprl_bench.__all__) <= 30


def test_public_names_and_their_homes_agree() -> None:
    assert sorted(sprl_bench._HOME_OF) == sorted(sprl_bench.__all__)
    assert set(sprl_bench.__all__) <= set(dir(sprl_bench))


def test_another_name_is_refused() -> None:
    assert not hasattr(sprl_bench, "recrod")
