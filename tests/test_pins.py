"""Which versions are pinned: for users those that can move a score and no others, for CI all."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterable
from pathlib import Path
from typing import Final

import pytest
from packaging.requirements import Requirement

from sprl_bench.doctor import pinned_versions
from sprl_bench.tables import SCORED_PACKAGES

ROOT: Final = Path(__file__).parents[1]


FILES: Final = ("constraints.txt", "constraints-ci.txt")


def lines_of(file: str) -> list[str]:
    return [line for line in (ROOT / file).read_text().splitlines() if line and not line.startswith("#")]


def pins_of(*files: str) -> list[Requirement]:
    return [Requirement(line) for file in files for line in lines_of(file) if not line.startswith("-")]


def names(requirements: Iterable[Requirement]) -> list[str]:
    return [one.name.lower().replace("_", "-") for one in requirements]


def test_users_get_pins_of_what_can_move_a_score_and_of_nothing_else() -> None:
    """Another library installs in its newest release beside them, not in one that fits our tools."""
    scored = {*SCORED_PACKAGES} - {"sprl-bench"}
    assert set(names(pins_of("constraints.txt"))) == set(pinned_versions()) == scored
    assert scored.isdisjoint({"tianshou", "torchrl", "typer", "pandas", "rich"})


def test_ci_has_the_same_pins_and_more_each_once() -> None:
    assert "-c constraints.txt" in lines_of("constraints-ci.txt")
    pinned = names(pins_of(*FILES))
    assert len(pinned) == len(set(pinned)) > 100


@pytest.mark.parametrize("file", FILES)
def test_every_pin_is_one_exact_version(file: str) -> None:
    assert not [pin for pin in pins_of(file) if not re.fullmatch(r"==[^*,]+", str(pin.specifier))]


def test_everything_that_the_project_asks_for_is_pinned_for_ci() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    extras = [one for group in project["optional-dependencies"].values() for one in group]
    wanted = names(map(Requirement, [*project["dependencies"], *extras]))
    assert set(wanted) - set(names(pins_of(*FILES))) == {"sprl-bench"}
