"""Records: what is written is what is read, and whatever else stands in a file is refused with one line."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from sprl_bench import records
from sprl_bench.records import (
    InvalidFileError,
    RunRecord,
    RunSpec,
    TaskSpec,
    find_records,
    hyperparameters_hash,
    read,
    write,
)
from sprl_bench.records.places import find_duplicate, find_line, values
from sprl_bench.tasks import SUITES

MakeRecord = Callable[..., RunRecord]

finite = st.floats(allow_nan=False, allow_infinity=False)
plain = st.recursive(
    st.none()
    | st.booleans()
    | st.integers(-(2**60), 2**60)
    | finite
    | st.text(st.characters(codec="utf-8"), max_size=9),
    lambda children: st.lists(children, max_size=3) | st.dictionaries(st.text("abc", max_size=3), children, max_size=3),
    max_leaves=8,
)


@settings(max_examples=40)
@given(
    curve=st.lists(st.floats(-1e6, 1e6), min_size=100, max_size=100),
    hyperparameters=st.dictionaries(st.text("abc_", min_size=1, max_size=4), plain, max_size=4),
    seed=st.integers(0, 2**40),
)
def test_a_record_comes_back_as_it_was_written(
    tmp_path_factory: pytest.TempPathFactory,
    make_record: MakeRecord,
    curve: list[float],
    hyperparameters: dict[str, Any],
    seed: int,
) -> None:
    record = make_record(seed=seed, curve=curve, hyperparameters=hyperparameters)
    path = tmp_path_factory.mktemp("record") / "record.json"
    write(path, record)
    again = read(path, RunRecord)
    assert again == record
    assert again.model_dump_json() == record.model_dump_json()  # 1 and 1.0 and True are equal, but not the same


@pytest.fixture
def written(make_record: MakeRecord, tmp_path: Path) -> Path:
    path = tmp_path / "record.json"
    write(path, make_record())
    return path


BROKEN = {
    "a score that is not finite": ('"auc": 0.5', '"auc": NaN', "scores.auc"),
    "infinity": ('"auc": 0.5', '"auc": Infinity', "scores.auc"),
    "a float that overflows": ('"auc": 0.5', '"auc": 1e999', "scores.auc"),
    "an amount that overflows": ('"wall_time_s": 1.5', '"wall_time_s": 1e999', "wall_time_s"),
    "a huge whole number for a float": ('"auc": 0.5', f'"auc": 1{"0" * 400}', "scores.auc"),
    "a huge whole number for a count": ('"seed": 0', f'"seed": 1{"0" * 400}', "spec.seed"),
    "a number of too many digits": ('"seed": 0', f'"seed": 1{"0" * 9_000}', "Invalid JSON"),
    "a number that is not whole": ('"budget": 100000', '"budget": 1.5', "spec.task.budget"),
    "a negative count": ('"episodes": 100', '"episodes": -1', "totals.episodes"),
    "a length of minus zero": ('"mean_length": 50.0', '"mean_length": -0.0', "mean_length: it is -0.0; it must be"),
    "a time of minus zero": ('"wall_time_s": 1.5', '"wall_time_s": -0.0', "wall_time_s: it is -0.0; it must be"),
    "text for a number": ('"auc": 0.5', '"auc": "0.5"', "scores.auc"),
    "a truth value for a number": ('"auc": 0.5', '"auc": true', "scores.auc"),
    "null for a number": ('"auc": 0.5', '"auc": null', "scores.auc"),
    "a misspelt key": ('"auc": 0.5', '"acu": 0.5', "scores.acu: this key is unknown; did you mean 'auc'?"),
    "an unknown key": ('"seed": 0', '"seed": 0,\n"sede": 1', "spec.sede: this key is unknown"),
    "a missing key": ('"wall_time_s": 1.5,', "", "wall_time_s: this key is missing"),
    "a key that is there twice": ('"seed": 0', '"seed": 0,\n"seed": 0', "spec.seed: this key is given twice"),
    "a status of its own": ('"complete"', '"finished"', "status"),
    "a folder outside of the runs": ('"agent": "ppo"', '"agent": "../ppo"', "spec.agent"),
    "a name that colours a terminal": ('"agent": "ppo"', r'"agent": "\u001b[31mppo"', "spec.agent"),
    "a name of two lines": ('"agent": "ppo"', r'"agent": "p\npo"', "spec.agent"),
    "a hyperparameter that is not finite": ("0.001", "NaN", "spec.hyperparameters.learning_rate"),
    "another hyperparameter": ("0.001", "0.002", "hyperparameters_hash does not follow"),
    "a score of its own": ('"auc": 0.5', '"auc": 0.75', "scores.auc is 0.75 but its curve gives 0.5"),
    "a threshold of its own": ('_threshold": 1000', '_threshold": 400', "scores.steps_to_threshold is 400"),
    "a whole run of few steps": ('"env_steps": 100000', '"env_steps": 5', "totals.env_steps is 5 of a budget"),
    "more successes than episodes": (
        '"successes": 50',
        '"successes": 101',
        "successes is 101, but there are 100",
    ),
    "a range without width": ("[\n    0.0,\n    1.0\n   ]", "[\n1.0,\n1.0]", "score_range"),
    "a version that is not known": ('"schema_version": 1', '"schema_version": 2', "schema_version"),
    "a lone surrogate": ('"made up"', r'"\ud800"', "Invalid JSON"),
}


@pytest.mark.parametrize("name", BROKEN)
def test_what_does_not_belong_is_refused_with_file_line_and_place(name: str, written: Path) -> None:
    before, after, place = BROKEN[name]
    text = written.read_text()
    assert before in text
    written.write_text(text.replace(before, after, 1))
    with pytest.raises(InvalidFileError) as caught:
        read(written, RunRecord)
    message = str(caught.value)
    assert "\n" not in message
    assert message.isprintable()
    assert len(message) < 700
    assert place in message
    line = re.match(re.escape(str(written)) + r":(\d+): ", message)
    assert line, message
    changed = text[: text.index(before)].count("\n") + 1
    near = int(line[1]) - changed
    assert near in (0, 1) or "missing" in message or "hash" in message or name == "a range without width"


def test_the_line_is_that_of_the_value(written: Path) -> None:
    lines = written.read_text().splitlines()
    number = next(number for number, line in enumerate(lines, 1) if '"return_curve"' in line) + 7
    lines[number - 1] = ' "high",'
    written.write_text("\n".join(lines))
    with pytest.raises(InvalidFileError, match=rf"record.json:{number}: return_curve\.6: .*, not 'high'"):
        read(written, RunRecord)


@pytest.mark.parametrize("length", [0, 1, 2, 100, 0.5, -3, -2])
def test_half_a_file_is_refused(written: Path, length: float) -> None:
    content = written.read_bytes()
    end = int(len(content) * length) if isinstance(length, float) else length
    written.write_bytes(content[:end])
    with pytest.raises(InvalidFileError, match=r":\d+: Invalid JSON"):
        read(written, RunRecord)


@pytest.mark.parametrize(
    "content",
    [
        b"\xff\xfe",
        b"\xef\xbb\xbf{}",
        b"[" * 100_000,
        b'{"a":' * 5_000,
        b"null",
        b"[]",
        b"{}",
        b'"text"',
        b"{} {}",
        b"\x00" * 50,
        b"cbuiltins\neval\n(S'1+1'\ntR.",
    ],
)
def test_other_files_are_refused(written: Path, content: bytes) -> None:
    written.write_bytes(content)
    with pytest.raises(InvalidFileError, match=r"record\.json:1: "):
        read(written, RunRecord)


def test_a_missing_file_is_no_invalid_one(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError):
        read(tmp_path / "record.json", RunRecord)


def test_curves_whose_sum_would_overflow_are_refused(make_record: MakeRecord) -> None:
    with pytest.raises(ValidationError, match="less than or equal"):
        make_record(return_curve=(1e308,) * 100)


def test_a_curve_has_100_bins(make_record: MakeRecord) -> None:
    for bins in (99, 101):
        with pytest.raises(ValidationError, match=r"return_curve"):
            make_record(return_curve=(0.5,) * bins)


def test_writing_replaces_all_or_nothing(
    written: Path, make_record: MakeRecord, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = written.read_bytes()

    def fail(_: int) -> None:
        raise OSError("no space left")

    monkeypatch.setattr(os, "fsync", fail)
    with pytest.raises(OSError, match="no space"):
        write(written, make_record(level=0.1))
    assert written.read_bytes() == before
    assert list(written.parent.iterdir()) == [written]


def test_a_link_and_a_pipe_stay_what_they_are(tmp_path: Path) -> None:
    (tmp_path / "link").symlink_to(tmp_path / "file")
    records.write_bytes(tmp_path / "link", b"one")
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "file").read_bytes() == b"one"
    os.mkfifo(tmp_path / "pipe")
    reader = os.open(tmp_path / "pipe", os.O_RDONLY | os.O_NONBLOCK)
    records.write_bytes(tmp_path / "pipe", b"two")
    assert os.read(reader, 9) == b"two"
    os.close(reader)
    assert (tmp_path / "pipe").is_fifo()


@pytest.mark.parametrize("way", [">>", "| cat >>"])
def test_standard_output_may_be_named(tmp_path: Path, way: str) -> None:
    (tmp_path / "log").write_text("before ")
    code = "from pathlib import Path; from sprl_bench.records import write_bytes as w; w(Path('/dev/stdout'), b'text')"
    command = f'"{sys.executable}" -c "{code}" {way} log; printf " after" >> log'
    subprocess.run(["bash", "-c", command], cwd=tmp_path, check=True)
    assert (tmp_path / "log").read_text() == "before text after"


@pytest.mark.skipif(not Path("/dev/shm").is_dir(), reason="needs a file system below /dev")
def test_a_folder_of_runs_may_lie_in_memory() -> None:
    with tempfile.TemporaryDirectory(dir="/dev/shm") as folder:
        for content in (b"one", b"two"):
            records.write_bytes(Path(folder) / "new" / "file", content)
        assert (Path(folder) / "new" / "file").read_bytes() == b"two"


def test_files_are_as_readable_as_the_umask_says(written: Path) -> None:
    other = written.parent / "other"
    other.touch()
    assert written.stat().st_mode == other.stat().st_mode


def test_the_hash_follows_from_names_and_values_alone() -> None:
    assert hyperparameters_hash({"a": 1, "b": [2, None]}) == hyperparameters_hash({"b": [2, None], "a": 1})
    different = [{}, {"a": 1}, {"a": 1.0}, {"a": True}, {"a": "1"}, {"b": 1}, {"a": 1, "b": None}]
    assert len({hyperparameters_hash(one) for one in different}) == len(different)
    # SHA-256 of {"a":1}, by coreutils.
    assert hyperparameters_hash({"a": 1}) == "015abd7f5cc57a2d"


def test_a_spec_says_where_its_run_lies(make_record: MakeRecord) -> None:
    path = make_record(seed=3).spec.path(Path("runs"))
    assert path == Path("runs/smoke/FourRooms-7x7/ppo/seed-3")


@pytest.mark.parametrize(
    "name",
    [
        "",
        ".",
        "..",
        ".hidden",
        "a/b",
        "a\\b",
        "a:b",
        'a"b',
        " a",
        "a ",
        "a\tb",
        "x" * 201,
        "a.",
        "a?b",
        "=A1",
        "字" * 70,
    ],
)
def test_a_name_that_cannot_be_a_folder_is_refused(make_record: MakeRecord, name: str) -> None:
    fields = make_record().spec.model_dump()
    with pytest.raises(ValidationError, match="agent"):
        RunSpec(**{**fields, "agent": name})


def test_every_task_of_every_suite_can_be_written() -> None:
    for suite in SUITES.values():
        for task in suite.tasks:
            spec = TaskSpec.of(task)
            assert TaskSpec.model_validate_json(spec.model_dump_json()) == spec


def test_records_are_found_in_the_order_of_their_paths(
    make_record: MakeRecord, write_runs: Callable[[list[RunRecord]], Path]
) -> None:
    made = [make_record(agent, seed=seed) for agent in ("b", "a") for seed in (1, 0)]
    root = write_runs(made)
    (root / "smoke" / "notes.json").write_text("{")
    found = find_records(root)
    assert [(record.spec.agent, record.spec.seed) for record in found] == [("a", 0), ("a", 1), ("b", 0), ("b", 1)]
    assert sorted(found, key=repr) == sorted(made, key=repr)
    assert find_records(root / "smoke" / "FourRooms-7x7" / "a") == found[:2]


def test_one_broken_record_is_named(make_record: MakeRecord, write_runs: Callable[[list[RunRecord]], Path]) -> None:
    root = write_runs([make_record(seed=seed) for seed in range(3)])
    broken = root / "smoke/FourRooms-7x7/ppo/seed-1/record.json"
    broken.write_text("{")
    with pytest.raises(InvalidFileError, match=re.escape(f"{broken}:1: ")):
        find_records(root)


def test_no_folder_and_an_empty_one_are_different(tmp_path: Path) -> None:
    assert find_records(tmp_path) == []
    with pytest.raises(FileNotFoundError, match="does not exist"):
        find_records(tmp_path / "nowhere")


TEXT = """{
 "a": {"b": [1,
   {"c": "x, \\"}]{["}], "d": null},

 "e": true}"""


def test_places_are_found_by_hand() -> None:
    assert dict(values(TEXT)) == {
        (): 1,
        ("a",): 2,
        ("a", "b"): 2,
        ("a", "b", 0): 2,
        ("a", "b", 1): 3,
        ("a", "b", 1, "c"): 3,
        ("a", "d"): 3,
        ("e",): 5,
    }
    assert find_line(TEXT, ("a", "b", 7, "missing")) == 2  # that of the list around it
    assert find_duplicate(TEXT) is None
    assert find_duplicate('{"a": [{"b": 1, "c": 2, "b": 3}], "a": 1}') == ("a", 0, "b")


@settings(max_examples=60)
@given(plain, st.sampled_from([None, 1]))
def test_places_are_those_of_any_json(value: Any, indent: int | None) -> None:
    text = json.dumps(value, indent=indent)

    def walk(value: Any, place: tuple[str | int, ...]) -> list[tuple[str | int, ...]]:
        inside = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
        return [place, *(found for key, child in inside for found in walk(child, (*place, key)))]

    assert [place for place, _ in values(text)] == walk(value, ())
    assert find_duplicate(text) is None


def test_nothing_is_evaluated_or_unpickled() -> None:
    """No loader of ours knows how to."""
    source = "".join(path.read_text() for path in Path(records.__file__).parent.glob("*.py"))
    assert not re.findall(r"\b(eval|exec|pickle|marshal|yaml|compile)\b(?<!re\.compile)", source)


def test_scores_are_a_function_of_the_curves(make_record: MakeRecord) -> None:
    record = make_record(curve=np.linspace(0, 1, 100))
    assert record.scores.auc == pytest.approx(0.5)
    assert record.scores.steps_to_threshold == 51 * 1_000  # bin 50 is 50/99
