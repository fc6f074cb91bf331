"""What the package shows: a short, sorted list of names, each of which is there."""

from __future__ import annotations

import pkgutil
from pathlib import Path

import pytest

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


def test_no_submodule_hides_a_public_name() -> None:
    submodules = {module.name for module in pkgutil.iter_modules(sprl_bench.__path__)}
    assert not submodules & set(sprl_bench.__all__)


def test_another_name_is_refused() -> None:
    assert not hasattr(sprl_bench, "recrod")


def test_paths_may_be_strings_everywhere(tmp_path: Path) -> None:
    specs = sprl_bench.expand(sprl_bench.find_suite("smoke"), ["random"], [0], budget=2_000)

    class Here:
        def map(self, function, waiting):
            for spec in waiting:
                yield spec, function(spec)

    root = str(tmp_path / "runs")
    [outcome] = sprl_bench.run_suite(specs, root, executor=Here())
    assert outcome.status == "finished", outcome.error
    assert len(sprl_bench.find_records(root)) == len(sprl_bench.survey(root)) == 1
    sprl_bench.plot(sprl_bench.find_records(root), str(tmp_path / "curves.png"))
    home = Path(__file__).parents[1] / "leaderboards"
    entries = sprl_bench.find_entries(str(home / "grid-7x7"))
    assert len(sprl_bench.boards(str(home), "grid-7x7")) == 1
    assert sprl_bench.validate([str(home / "grid-7x7" / "ppo.json")]) == []
    assert sprl_bench.add_entry(entries[0], str(tmp_path / "boards")).exists()


def test_the_folder_of_all_boards_is_not_an_empty_board() -> None:
    with pytest.raises(ValueError, match="is the folder of all boards; name one of them: grid-7x7"):
        sprl_bench.find_entries(Path(__file__).parents[1] / "leaderboards")
