"""A corpus of malformed and hostile files: each is refused in one line, with an exit status, and touches nothing.

A case is a name, the kind of file, and how it is made from a sound one; `HARM_JSON` spoils any JSON file.
"""

from __future__ import annotations

import contextlib
import json
import os
import signal
import struct
import sys
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import pytest

from cli_calls import Capture, call
from sprl_bench import checkpoint, leaderboard, records
from sprl_bench.records import RunRecord, RunSpec
from sprl_bench.records.folder import ACTIONS, CHECKPOINT, EPISODES, LOCK, METRICS, RECORD, SPEC, WEIGHTS
from sprl_bench.run import run
from sprl_bench.suite import expand
from sprl_bench.tasks import find_suite

Change = Callable[[bytes], bytes]
MakeRecord = Callable[..., RunRecord]
ABOUT: Final = {"authors": ["Ada"], "link": "https://example.org/a"}


def changed(change: Callable[[Any], object]) -> Change:
    """Return a change of the bytes of a JSON file from one of its content."""

    def apply(content: bytes) -> bytes:
        data = json.loads(content)
        result = change(data)
        return json.dumps(data if result is None else result).encode()

    return apply


def put(path: str, value: Any) -> Change:
    """Return the change that puts `value` at a place such as "spec.task.name"; `...` removes what is there."""

    def change(data: Any) -> None:
        *outer, last = [int(part) if part.isdecimal() else part for part in path.split(".")]
        for part in outer:
            data = data[part]
        if value is ...:
            del data[last]
        else:
            data[last] = value

    return changed(change)


def raw(path: str, text: str) -> Change:
    """Return the change that puts JSON text, such as NaN, at a place."""
    return lambda content: put(path, "@@@")(content).replace(b'"@@@"', text.encode())


def twice(key: str) -> Change:
    """Return the change that gives the first key of an object twice."""
    return lambda content: content.replace(f'"{key}"'.encode(), f'"{key}": null, "{key}"'.encode(), 1)


HARM_JSON: Final[dict[str, Change]] = {
    "empty": lambda _: b"",
    "half": lambda content: content[: len(content) // 2],
    "nul": lambda content: b"\0" * len(content),
    "not-utf-8": lambda content: content.replace(b'"', b'"\xff\xfe', 1),
    "byte-order-mark": lambda content: b"\xef\xbb\xbf" + content,
    "utf-16": lambda content: content.decode().encode("utf-16"),
    "utf-32": lambda content: content.decode().encode("utf-32"),
    "nested": lambda _: b"[" * 100_000,
    "nested-objects": lambda _: b'{"a":' * 50_000,
    "two-documents": lambda content: content + content,
    "a-list": lambda content: b"[" + content + b"]",
    "a-number": lambda _: b"1",
    "unknown-key": changed(lambda data: {**data, "\x1b[2Jevil": 1}),
    "nothing-in-it": lambda _: b"{}",
    "python": lambda _: b"__import__('os').system('touch executed')",
    "pickle": lambda _: b"\x80\x04\x95\x1e\x00\x00\x00cposix\nsystem\n(S'touch executed'\ntR.",
    "yaml": lambda _: b"!!python/object/apply:os.system ['touch executed']\n",
    "html": lambda _: b"<script>alert(1)</script>",
}
RECORDS: Final[dict[str, Change]] = {
    "nan": raw("scores.auc", "NaN"),
    "infinite": raw("scores.auc", "1e999"),
    "forged-score": put("scores.auc", 0.99),
    "forged-curve": put("return_curve.99", 1.0),
    "short-curve": put("return_curve", [0.5] * 99),
    "long-curve": put("return_curve", [0.5] * 10_000),
    "a-text-as-number": put("wall_time_s", "1.5"),
    "a-fraction-as-count": put("spec.seed", 0.5),
    "a-negative-seed": put("spec.seed", -1),
    "a-huge-seed": raw("spec.seed", "9" * 5_000),
    "path-in-agent": put("spec.agent", "../../evil"),
    "absolute-agent": put("spec.agent", "/etc/evil"),
    "path-in-suite": put("spec.suite", ".."),
    "path-in-task": put("spec.task.name", "a/b"),
    "escape-codes-in-agent": put("spec.agent", "\x1b]0;evil\x07"),
    "line-break-in-agent": put("spec.agent", "a\nb"),
    "spreadsheet-formula": put("spec.agent", "=cmd|' /C calc'!A0"),
    "long-agent": put("spec.agent", "a" * 100_000),
    "surrogate": raw("spec.agent", '"\\ud800"'),
    "another-hash": put("spec.hyperparameters_hash", "0" * 16),
    "more-successes-than-episodes": put("totals.successes", 10**6),
    "more-steps-than-budget": put("totals.env_steps", 10**9),
    "status-of-a-half": put("status", "incomplete"),
    "unknown-status": put("status", "finished"),
    "no-spec": put("spec", ...),
    "key-twice": twice("status"),
    "another-format": put("schema_version", 2),
    "a-range-that-is-none": put("spec.task.score_range", [1.0, 0.0]),
    "arguments-that-are-code": put("spec.task.arguments", {"wrappers": ["os:system"]}),
}
SPECS: Final[dict[str, Change]] = {
    "another-seed": put("seed", 7),
    "another-agent": put("agent", "other"),
    "no-task": put("task", ...),
    "unknown-information": put("information", ["psychic"]),
    "a-difference-that-is-none": put("differences", {"gamma": 0.5}),
    "key-twice": twice("seed"),
}
ENTRIES: Final[dict[str, Change]] = {
    "forged-score": put("tasks.0.results.0.scores.auc", 0.99),
    "outside-of-its-range": put("tasks.0.results.0.return_curve.0", 1.5),
    "a-link-that-is-code": put("link", "javascript:alert(1)"),
    "a-link-with-a-user": put("link", "https://github.com@evil.example/a"),
    "a-link-with-a-tag": put("link", 'https://a.bc/"><script>'),
    "escape-codes-in-author": put("authors", ["\x1b[2J"]),
    "no-author": put("authors", []),
    "four-seeds": changed(lambda data: [part["results"].pop() for part in data["tasks"]] and None),
    "one-seed-twice": put("tasks.0.results.1.seed", 0),
    "other-seeds": put("tasks.1.results.4.seed", 9),
    "unknown-suite": put("suite", "grid-9x9"),
    "earlier-version": put("suite_version", 0),
    "another-budget": put("tasks.0.task.budget", 10),
    "another-environment": put("tasks.0.task.env_id", "evil:Evil-v0"),
    "too-many-environments": put("tasks.0.num_envs", 100_000),
    "another-agent": put("agent", "other"),
    "two-versions": put("versions.numpy", "1.0, 2.0"),
    "no-versions": put("versions", {}),
    "key-twice": twice("agent"),
}
PENDING: Final[dict[str, Change]] = {
    "another-agent": put("runs.0.spec.agent", "other"),
    "one-run-twice": changed(lambda data: data["runs"].append(data["runs"][0])),
    "an-unknown-task": put("runs.0.spec.task.name", "nowhere"),
    "no-run": put("runs", []),
    "forged-score": put("runs.0.scores.auc", 0.99),
}
SWEEPS: Final[dict[str, Change]] = {
    "no-seeds": put("seeds", []),
    "a-budget-of-none": put("tasks", {"FourRooms-7x7": 0}),
    "a-name-twice": changed(lambda data: data["settings"]["random"].append(data["settings"]["random"][0])),
    "a-path-as-suite": put("suite", "../.."),
}
RANGES: Final[dict[str, tuple[str, bytes]]] = {
    "toml-half": (".toml", b"[random]\nnum_envs = [1,"),
    "toml-twice": (".toml", b"[random]\nnum_envs = [1]\nnum_envs = [2]\n"),
    "toml-mark": (".toml", b"\xef\xbb\xbf[random]\nnum_envs = [1]\n"),
    "toml-not-utf-8": (".toml", b"[random]\nx = ['\xff']\n"),
    "toml-no-list": (".toml", b"[random]\nnum_envs = 3\n"),
    "toml-empty-list": (".toml", b"[random]\nnum_envs = []\n"),
    "toml-another-agent": (".toml", b"[other]\nnum_envs = [1]\n"),
    "toml-unknown-key": (".toml", b"[random]\nlearning_rat = [1]\n"),
    "toml-nested": (".toml", b"[random]\nx = " + b"[" * 5_000),
    "json-list": (".json", b"[1, 2]"),
    "json-nested": (".json", b"[" * 100_000),
    "json-code": (".json", b"__import__('os')"),
    "json-text": (".json", b'{"random": "num_envs"}'),
}


@dataclass(frozen=True)
class World:
    """Sound files of each kind, in a folder of their own for each case."""

    root: Path

    @property
    def run(self) -> Path:
        return self.root / "runs" / "custom" / "FourRooms-7x7-600" / "random" / "seed-0"

    def words(self, kind: str) -> list[object]:
        """Return the command that reads the file of this kind."""
        root = self.root
        return {
            "record": ["table", root / "one"],
            "spec": ["status", root / "begun"],
            "metrics": ["plot", root / "runs", "-o", root / "a.svg", "--metric", "return"],
            "episodes": ["verify", root / "runs"],
            "tape": ["verify", root / "runs"],
            "weights": ["video", "SPRL/FourRooms-7x7-v1", "-o", root / "a.gif", "--run", root / "trained"],
            "entry": ["leaderboard", "validate", self.path("entry")],
            "pending": ["leaderboard", "show", "--pending", "--home", root / "boards"],
            "sweep": ["sweep", "report", root / "sweep"],
        }[kind]

    def path(self, kind: str) -> Path:
        root = self.root
        return {
            "record": root / "one" / "smoke" / "FourRooms-7x7" / "ppo" / "seed-0" / RECORD,
            "spec": root / "begun" / "smoke" / "FourRooms-7x7" / "ppo" / "seed-0" / SPEC,
            "metrics": self.run / METRICS,
            "episodes": self.run / EPISODES,
            "tape": self.run / ACTIONS,
            "weights": root / "trained" / WEIGHTS,
            "entry": root / "boards" / "grid-7x7" / "ppo.json",
            "pending": root / "boards" / "pending" / "grid-7x7" / "ppo.json",
            "sweep": root / "sweep" / "sweep.json",
        }[kind]


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory, make_record: Callable[..., RunRecord]) -> World:
    """Sound files, once for all cases."""
    world = World(tmp_path_factory.mktemp("sound"))
    record = make_record()
    records.write(world.path("record"), record)
    records.write(world.path("spec"), record.spec)
    ppo = [
        make_record("ppo", task, seed, suite="grid-7x7", level=0.4 + 0.05 * seed)
        for task in ("FourRooms-7x7", "KeyDoors-7x7")
        for seed in range(5)
    ]
    home = world.root / "boards"
    leaderboard.add_entry(leaderboard.make_entry(ppo, agent="ppo", **ABOUT), home)  # type: ignore[arg-type]
    leaderboard.add_pending(ppo, home, agent="ppo")
    [spec] = expand(find_suite("smoke"), ["random"], [0], budget=600)
    run(spec, world.root / "runs", keep_actions=True)
    [trained] = expand(find_suite("smoke"), ["ppo"], [0], budget=1_600)
    run(trained, world.root / "training")
    (world.root / "trained").mkdir()
    for name in (SPEC, WEIGHTS):
        (world.root / "trained" / name).write_bytes((trained.path(world.root / "training") / name).read_bytes())
    (world.root / "sweep").mkdir()
    declared = {
        "suite": "smoke",
        "suite_version": 2,
        "tasks": {"FourRooms-7x7": 600},
        "seeds": [100],
        "settings": {"random": [{"name": "random", "values": {}}]},
    }
    world.path("sweep").write_text(json.dumps(declared))
    return world


def snapshot(root: Path) -> dict[str, tuple[int, bytes | None]]:
    """Return all that lies below a folder: times of change and content."""
    return {
        str(path): (path.lstat().st_mtime_ns, path.read_bytes() if path.is_file() else None)
        for path in [root, *root.rglob("*")]
    }


def check_refused(words: list[object], root: Path, capsys: Capture) -> str:
    """Check that a command refuses a file in one line and touches nothing; return the line."""
    before, here = snapshot(root), set(Path.cwd().iterdir())
    loaded = set(sys.modules)
    status, out, err = call(capsys, *words)
    assert status in (1, 2), out
    lines = err.splitlines()
    assert len(lines) == 1, err
    assert len(lines[0]) < 2_000
    assert lines[0].isprintable()
    assert "Traceback" not in err
    assert snapshot(root) == before
    assert set(Path.cwd().iterdir()) == here
    assert not {"evil", "posix_evil"} & (set(sys.modules) - loaded)
    return lines[0]


JSON_CASES: Final = [
    (kind, name, change)
    for kind, own in (("record", RECORDS), ("spec", SPECS), ("entry", ENTRIES), ("pending", PENDING), ("sweep", SWEEPS))
    for name, change in {**HARM_JSON, **own}.items()
]


@pytest.mark.parametrize(("kind", "name", "change"), JSON_CASES, ids=[f"{one[0]}-{one[1]}" for one in JSON_CASES])
def test_a_json_file_is_refused(kind: str, name: str, change: Change, sound: World, capsys: Capture) -> None:
    path = sound.path(kind)
    content = path.read_bytes()
    path.write_bytes(change(content))
    try:
        line = check_refused(sound.words(kind), sound.root, capsys)
        assert str(path.parent) in line
    finally:
        path.write_bytes(content)


@pytest.mark.parametrize("kind", ["record", "spec", "entry", "pending", "sweep", "weights", "episodes", "tape"])
@pytest.mark.parametrize("special", ["fifo", "folder", "device"])
def test_what_is_no_file_is_refused(kind: str, special: str, sound: World, capsys: Capture) -> None:
    path = sound.path(kind)
    aside = path.rename(sound.root.parent / "aside")
    try:
        if special == "fifo":
            os.mkfifo(path)
        elif special == "folder":
            path.mkdir()
        else:
            path.symlink_to("/dev/zero")
        status, _, err = call(capsys, *sound.words(kind))
        assert status in (1, 2)
        assert err.count("\n") == 1, err
        assert "Traceback" not in err
    finally:
        path.rmdir() if path.is_dir() and not path.is_symlink() else path.unlink()
        aside.rename(path)


@pytest.fixture
def two_runs(make_record: MakeRecord, tmp_path: Path) -> tuple[Path, Path]:
    """A folder with a finished run and one that has only begun, and the folder of that one."""
    root = tmp_path / "runs"
    done, begun = make_record("ppo", suite="smoke"), make_record("ppo", seed=1, suite="smoke").spec
    records.write(done.spec.path(root) / RECORD, done)
    records.write(begun.path(root) / SPEC, begun)
    (begun.path(root) / "error.txt").write_text("RuntimeError: out of luck\n")
    return root, begun.path(root)


@contextlib.contextmanager
def within(seconds: int) -> Iterator[None]:
    """Fail if the block takes longer, as one that waits for a pipe does."""

    def fail(*_: object) -> None:
        raise TimeoutError(f"still there after {seconds} seconds")

    before = signal.signal(signal.SIGALRM, fail)
    signal.alarm(seconds)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)


@pytest.mark.parametrize("name", [METRICS, LOCK, "error.txt"])
@pytest.mark.parametrize("special", ["fifo", "device"])
def test_a_pipe_in_a_run_that_has_begun_stops_no_other(
    name: str, special: str, two_runs: tuple[Path, Path], capsys: Capture, tmp_path: Path
) -> None:
    root, begun = two_runs
    (begun / name).unlink(missing_ok=True)
    os.mkfifo(begun / name) if special == "fifo" else (begun / name).symlink_to("/dev/zero")
    for words in (
        ["status", root],
        ["table", root, "--allow-missing"],
        ["report", root, "-o", tmp_path / "report.html", "--allow-missing"],
    ):
        with within(30):
            status, out, err = call(capsys, *words)
        assert "Traceback" not in out + err
        assert status == 0 or words[0] == "status", err
        assert {"status": "1 finished", "table": "ppo"}.get(words[0], "") in out
        if name == METRICS:
            page = (tmp_path / "report.html").read_text() if words[0] == "report" else ""
            assert "is not a regular file" in out + err + page


@pytest.mark.parametrize("name", [METRICS, LOCK, "output.txt"])
def test_a_run_does_not_wait_for_a_pipe(name: str, capsys: Capture, tmp_path: Path) -> None:
    words = ["run", "--suite", "smoke", "--agents", "random", "--seeds", 1, "--budget", 500, "--workers", 1]
    folder = tmp_path / "runs" / "custom" / "FourRooms-7x7-500" / "random" / "seed-0"
    folder.mkdir(parents=True)
    os.mkfifo(folder / name)
    with within(60):
        status, out, err = call(capsys, *words, "--out", tmp_path / "runs")
    assert status == 1, out
    assert f"{folder / name} is not a regular file; it must be one." in err
    assert "Traceback" not in err


BLOCK: Final = struct.Struct("<cI")


def block(letter: bytes, content: bytes) -> bytes:
    compressed = zlib.compress(content)
    return BLOCK.pack(letter, len(compressed)) + compressed


def padded(content: bytes) -> bytes:
    """Return a tape of which the first block has three bytes after its content."""
    line, _, rest = content.partition(b"\n")
    letter, length = BLOCK.unpack_from(rest)
    end = BLOCK.size + length
    return line + b"\n" + BLOCK.pack(letter, length + 3) + rest[BLOCK.size : end] + b"abc" + rest[end:]


def head(**changes: Any) -> Change:
    """Return the change of a tape's head."""

    def change(content: bytes) -> bytes:
        line, _, rest = content.partition(b"\n")
        return json.dumps({**json.loads(line), **changes}).encode() + b"\n" + rest

    return change


def instead(*blocks: bytes) -> Change:
    """Return the change of all blocks of a tape."""
    return lambda content: content.partition(b"\n")[0] + b"\n" + b"".join(blocks)


TAPES: Final[dict[str, Change]] = {
    "empty": lambda _: b"",
    "no-head": lambda content: content.partition(b"\n")[2],
    "half": lambda content: content[: len(content) // 2],
    "one-byte-less": lambda content: content[:-1],
    "one-byte-more": lambda content: content + b"S",
    "another-format": head(format=2),
    "unknown-key": head(evil=1),
    "no-environments": head(num_envs=0),
    "negative-environments": head(num_envs=-1),
    "many-environments": head(num_envs=10**12),
    "other-environments": head(num_envs=3),
    "environments-as-text": head(num_envs="2"),
    "unknown-mode": head(autoreset="Sometimes"),
    "mode-as-code": head(autoreset="__import__('os')"),
    "huge-shape": head(discrete=0, shape=[10**9, 10**9]),
    "object-type": head(discrete=0, dtype="object"),
    "many-actions": head(discrete=10**30),
    "unknown-block": instead(block(b"X", b"")),
    "bomb": instead(BLOCK.pack(b"S", 0) + b""),
    "large-bomb": instead(block(b"S", b"\0" * 2**29)),
    "long-block": instead(BLOCK.pack(b"S", 2**32 - 1) + b"\0"),
    "not-compressed": instead(BLOCK.pack(b"S", 3) + b"abc"),
    "count-without-content": instead(block(b"S", struct.pack("<Q", 2**60))),
    "reset-of-nothing": instead(block(b"R", b'["x", null, null]')),
    "reset-with-a-path": instead(block(b"R", b'[-1, "../x", null]')),
    "reset-with-a-mask-of-one": instead(block(b"R", b"[-1, null, [true]]")),
    "reset-nested": instead(block(b"R", b"[" * 100_000)),
    "key-twice": lambda content: content.replace(b'"format"', b'"format":1,"format"', 1),
    "a-large-head": lambda content: content.replace(b"{", b"{" + b" " * 10**6, 1),
    "more-than-its-content": padded,
    "close-of-a-far-one": instead(block(b"C", b"[4294967295]")),
}


@pytest.mark.parametrize("name", TAPES)
def test_a_tape_is_refused(name: str, sound: World, capsys: Capture) -> None:
    path = sound.path("tape")
    content = path.read_bytes()
    path.write_bytes(TAPES[name](content))
    try:
        status, out, err = call(capsys, *sound.words("tape"))
        assert (status, out.splitlines()[-1]) == (1, "0 of 1 runs are replayed equal.")
        assert len(out.splitlines()) + len(err.splitlines()) == 2, out + err
        assert "Traceback" not in err
    finally:
        path.write_bytes(content)


def parquet(**columns: Any) -> bytes:
    import io

    import pyarrow
    from pyarrow import parquet as files

    buffer = io.BytesIO()
    files.write_table(pyarrow.table(columns), buffer, compression="zstd")
    return buffer.getvalue()


EPISODE_FILES: Final[dict[str, Change]] = {
    "empty": lambda _: b"",
    "half": lambda content: content[: len(content) // 2],
    "garbage": lambda content: b"PAR1" + b"\xff" * 100 + b"PAR1",
    "csv": lambda _: b"stamp,env,return\n1,0,1.0\n",
    "other-columns": lambda _: parquet(evil=[1, 2]),
    "a-thousand-million-rows": lambda _: parquet(stamp=np.zeros(10_000_000, np.int64)),
    "text-in-columns": lambda _: parquet(stamp=["a"], env=["b"], **{"return": ["c"]}, length=["d"], success=["e"]),
}


@pytest.mark.parametrize("name", EPISODE_FILES)
def test_a_file_of_episodes_is_refused(name: str, sound: World, capsys: Capture) -> None:
    path = sound.path("episodes")
    content = path.read_bytes()
    path.write_bytes(EPISODE_FILES[name](content))
    try:
        status, out, err = call(capsys, *sound.words("episodes"))
        assert (status, out.splitlines()[-1]) == (1, "0 of 1 runs are replayed equal.")
        assert len(out.splitlines()) + len(err.splitlines()) == 2, out + err
    finally:
        path.write_bytes(content)


def safetensors(tree: str, arrays: dict[str, Any] | None = None) -> bytes:
    """Return a checkpoint of any content with a digest that is right."""
    from safetensors.numpy import save

    found = arrays or {}
    return save(found, {"format": "1", "tree": tree, "digest": checkpoint._digest(tree, found)})


WEIGHT_FILES: Final[dict[str, Change]] = {
    "empty": lambda _: b"",
    "half": lambda content: content[: len(content) // 2],
    "one-bit": lambda content: content[:-1] + bytes([content[-1] ^ 1]),
    "huge-header": lambda content: struct.pack("<Q", 2**60) + content[8:],
    "header-of-nothing": lambda _: struct.pack("<Q", 2) + b"{}",
    "pickle": lambda _: b"\x80\x04cposix\nsystem\n(S'touch executed'\ntR.",
    "zip": lambda _: b"PK\x03\x04" + b"\0" * 100,
    "no-json": lambda _: safetensors("{"),
    "unknown-kind": lambda _: safetensors('["evil", "0"]', {"0": np.ones(2)}),
    "no-such-array": lambda _: safetensors('["mapping", [["agent", ["array", "7"]]]]'),
    "a-list": lambda _: safetensors('["list", []]'),
    "nested": lambda _: safetensors("[" * 50_000),
    "nested-lists": lambda _: safetensors('["list",[' * 900 + "]]" * 900),
    "no-agent": lambda _: safetensors('["mapping", []]'),
    "another-agent": lambda _: safetensors('["mapping", [["agent", ["mapping", [["x", 1]]]]]]'),
}


@pytest.mark.parametrize("file", [WEIGHTS, CHECKPOINT])
@pytest.mark.parametrize("name", WEIGHT_FILES)
def test_weights_are_refused(name: str, file: str, sound: World, capsys: Capture) -> None:
    path = sound.path("weights").with_name(file)
    content = sound.path("weights").read_bytes()
    path.write_bytes(WEIGHT_FILES[name](content))
    try:
        assert str(path) in check_refused(sound.words("weights"), sound.root, capsys)
    finally:
        path.unlink()
        sound.path("weights").write_bytes(content)


@pytest.mark.parametrize("name", RANGES)
def test_a_file_of_ranges_is_refused(name: str, capsys: Capture, tmp_path: Path) -> None:
    suffix, content = RANGES[name]
    path = tmp_path / f"ranges{suffix}"
    path.write_bytes(content)
    words = ["sweep", "--suite", "smoke", "--agents", "random", "--range", path, "--out", tmp_path / "sweep"]
    check_refused([*words, "--dry-run"], tmp_path, capsys)


METRICS_FILES: Final[dict[str, bytes]] = {
    "nul": b"\0" * 600 + b"\n",
    "no-object": b"[1]\n3\n",
    "half": b'{"return": 1.0\n',
    "not-utf-8": b"\xff\xfe\n",
    "nested": b"[" * 100_000 + b"\n",
    "text": b'{"return": "x", "env_steps": "y"}\n{"return": "x", "env_steps": "y"}\n',
    "no-steps": b'{"return": 1.0}\n{"return": 1.0}\n',
    "huge": b'{"return": 1e999, "env_steps": 1}\n{"return": NaN, "env_steps": 2}\n',
}


@pytest.mark.parametrize("name", METRICS_FILES)
def test_diagnostics_are_refused_where_they_are_drawn(name: str, sound: World, capsys: Capture) -> None:
    path = sound.path("metrics")
    content = path.read_bytes()
    path.write_bytes(METRICS_FILES[name])
    try:
        assert str(path.parent) in check_refused(sound.words("metrics"), sound.root, capsys)
    finally:
        path.write_bytes(content)


def test_a_record_that_names_a_module_loads_none(
    sound: World, capsys: Capture, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Gymnasium would import "evil" for the environment, and the harness for the agent."""
    (tmp_path / "evil.py").write_text("open('executed', 'w').close()\n")
    monkeypatch.chdir(tmp_path)
    path = sound.run / RECORD
    content = path.read_bytes()
    for place, value in (("spec.task.env_id", "evil:Evil-v0"), ("spec.source", "evil:agent")):
        path.write_bytes(put(place, value)(content))
        try:
            call(capsys, "verify", sound.root / "runs")
        finally:
            path.write_bytes(content)
    entry = put("tasks.0.source", "evil:agent")(sound.path("entry").read_bytes())
    own = tmp_path / "grid-7x7" / "ppo.json"
    own.parent.mkdir()
    own.write_bytes(entry)
    words = ["reproduce-row", own, "--task", "FourRooms-7x7", "--seed", "0"]
    assert "it must be 'evil:agent', as code is loaded only if you name it" in check_refused(words, tmp_path, capsys)
    assert not (tmp_path / "executed").exists()


def sizes() -> Iterator[int]:
    yield len(JSON_CASES)
    yield 8 * 3
    yield from map(len, (TAPES, EPISODE_FILES, RANGES, METRICS_FILES))
    yield 2 * len(WEIGHT_FILES)


def test_the_corpus_is_large() -> None:
    assert sum(sizes()) >= 200
    assert RunSpec.model_config["extra"] == RunRecord.model_config["extra"] == "forbid"
