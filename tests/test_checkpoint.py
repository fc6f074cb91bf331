"""Checkpoints: what goes in comes out, and a file that is not whole is never taken for one."""

from __future__ import annotations

import json
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from safetensors.numpy import save as serialise

from sprl_bench import checkpoint
from sprl_bench.checkpoint import BrokenCheckpointError, load, save

PLAIN = st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | st.text(max_size=5)
ARRAYS = st.builds(
    lambda shape, dtype: (np.arange(int(np.prod(shape))) % 7).reshape(shape).astype(dtype),
    st.lists(st.integers(0, 3), max_size=3).map(tuple),
    st.sampled_from(["<f8", "<f4", "<f2", "<i8", "<i4", "<u1", "<u8", "?"]),
)
STATES = st.dictionaries(
    st.text(max_size=5),
    st.recursive(
        PLAIN | ARRAYS,
        lambda inner: (
            st.lists(inner, max_size=3)
            | st.lists(inner, max_size=3).map(tuple)
            | st.dictionaries(st.text(max_size=3) | st.integers() | st.booleans(), inner, max_size=3)
        ),
        max_leaves=8,
    ),
    max_size=4,
)


def assert_same(one: Any, other: Any) -> None:
    """Compare in value and type, all the way down; keys in order."""
    assert type(one) is type(other)
    if isinstance(one, dict):
        assert [(type(key), key) for key in one] == [(type(key), key) for key in other]
        for key in one:
            assert_same(one[key], other[key])
    elif isinstance(one, list | tuple):
        assert len(one) == len(other)
        for left, right in zip(one, other, strict=True):
            assert_same(left, right)
    elif isinstance(one, np.ndarray | torch.Tensor):
        assert (one.dtype, one.shape) == (other.dtype, other.shape)
        assert bytes(np.asarray(one)) == bytes(np.asarray(other))
    else:
        assert one == other


@settings(deadline=None, max_examples=30)
@given(STATES)
def test_what_goes_in_comes_out(tmp_path_factory: pytest.TempPathFactory, state: dict[str, Any]) -> None:
    path = tmp_path_factory.mktemp("state") / "checkpoint"
    save(path, state)
    assert_same(load(path), state)


def test_tensors_scalars_and_generators_come_back(tmp_path: Path) -> None:
    model = torch.nn.Linear(3, 2)
    optimizer = torch.optim.Adam(model.parameters(), betas=(0.8, 0.9))
    model(torch.ones(4, 3)).sum().backward()
    optimizer.step()
    generator = torch.Generator().manual_seed(3)
    state = {
        "model": dict(model.state_dict()),
        "optimizer": optimizer.state_dict(),
        "generator": generator.get_state(),
        "numpy": np.random.default_rng(1).bit_generator.state,
        "mersenne": np.random.MT19937(1).state,
        "scalars": (np.float32(0.1), np.uint64(2**63), np.bool_(True)),
        "extremes": [float("inf"), -0.0, 5e-324, 2**200],
        "empty": torch.zeros(0, 3),
        "parameter": model.weight,
        "transposed": torch.arange(6).reshape(2, 3).T,
    }
    save(tmp_path / "checkpoint", state)
    found = load(tmp_path / "checkpoint")
    assert_same(found.pop("parameter"), model.weight.detach())
    state.pop("parameter")
    assert_same(found, {**state, "transposed": state["transposed"].contiguous()})
    torch.optim.Adam(model.parameters()).load_state_dict(found["optimizer"])


def test_bfloat16_comes_back(tmp_path: Path) -> None:
    values = torch.tensor([1.5, -2.0, float("inf")], dtype=torch.bfloat16)
    save(tmp_path / "checkpoint", {"values": values})
    found = load(tmp_path / "checkpoint")["values"]
    assert found.dtype is torch.bfloat16
    assert torch.equal(found, values)


IMAGES = np.random.default_rng(0).integers(0, 4, (50, 3, 84, 84)).astype(np.uint8)  # more than a megabyte


@pytest.mark.parametrize(
    "images",
    [IMAGES, IMAGES.T, torch.from_numpy(IMAGES), torch.from_numpy(IMAGES).movedim(1, 3), IMAGES.astype(np.int8)],
    ids=["array", "transposed array", "tensor", "transposed tensor", "signed"],
)
def test_images_come_back(tmp_path: Path, images: Any) -> None:
    save(tmp_path / "checkpoint", {"images": images})
    loaded = load(tmp_path / "checkpoint")["images"]
    assert_same(loaded, images)
    loaded[0] = 1


def test_images_take_less_room_than_their_bytes(tmp_path: Path) -> None:
    save(tmp_path / "checkpoint", {"images": IMAGES, "unused": torch.zeros(2**20, dtype=torch.uint8)})
    assert (tmp_path / "checkpoint").stat().st_size < IMAGES.nbytes / 2


def _compressed(content: bytes, shape: list[int]) -> tuple[str, dict[str, np.ndarray]]:
    tree = ["mapping", [["images", ["compressed", ["array", "0", shape]]]]]
    return json.dumps(tree), {"0": np.frombuffer(content, np.uint8)}


@pytest.mark.parametrize(
    ("content", "shape"),
    [
        (zlib.compress(b"12345"), [2, 3]),
        (zlib.compress(b"1234567"), [2, 3]),
        (zlib.compress(bytes(10**8)), [2, 3]),
        (zlib.compress(b"123456")[:-7], [2, 3]),
        (b"no such bytes", [2, 3]),
    ],
    ids=["too few", "too many", "far too many", "cut off", "no compressed bytes"],
)
def test_compressed_bytes_that_are_no_such_images_are_refused(tmp_path: Path, content: bytes, shape: list[int]) -> None:
    tree, arrays = _compressed(content, shape)
    metadata = {"format": "1", "tree": tree, "digest": checkpoint._digest(tree, arrays)}
    (tmp_path / "checkpoint").write_bytes(serialise(arrays, metadata))
    with pytest.raises(BrokenCheckpointError, match="is not a whole checkpoint"):
        load(tmp_path / "checkpoint")


def test_what_was_loaded_can_be_changed(tmp_path: Path) -> None:
    save(tmp_path / "checkpoint", {"array": np.zeros(3), "tensor": torch.zeros(3)})
    found = load(tmp_path / "checkpoint")
    found["array"] += 1
    found["tensor"] += 1
    assert found["tensor"].sum() == found["array"].sum() == 3


@pytest.fixture
def whole(tmp_path: Path) -> Path:
    path = tmp_path / "checkpoint"
    save(path, {"weights": np.arange(40.0), "steps": 7})
    return path


def test_a_truncated_file_is_no_checkpoint(whole: Path) -> None:
    content = whole.read_bytes()
    for length in range(0, len(content), 7):
        whole.write_bytes(content[:length])
        with pytest.raises(BrokenCheckpointError, match="is not a whole checkpoint"):
            load(whole)


def test_no_changed_byte_goes_unnoticed(whole: Path) -> None:
    content = whole.read_bytes()
    for place in range(0, len(content), 3):
        whole.write_bytes(content[:place] + bytes([content[place] ^ 1]) + content[place + 1 :])
        try:
            found = load(whole)
        except BrokenCheckpointError as error:
            assert "\n" not in str(error)  # noqa: PT017 - most changes must raise, a blank in the header may not
        else:
            assert_same(found, {"weights": np.arange(40.0), "steps": 7})


@pytest.mark.parametrize("content", [b"", b"{}", b"\0" * 4096, b"\x02\0\0\0\0\0\0\0{}", b"\xff" * 64])
def test_other_files_are_no_checkpoints(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "checkpoint").write_bytes(content)
    with pytest.raises(BrokenCheckpointError, match="is not a whole checkpoint"):
        load(tmp_path / "checkpoint")


def test_no_file_is_no_broken_file(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError):
        load(tmp_path / "checkpoint")


@pytest.mark.parametrize(
    ("value", "message"),
    [
        (print, r"state.agent.1 is a builtin_function_or_method"),
        (np.array(["text"]), r"state.agent.1 is an array of <U4"),
        (np.array([None]), r"state.agent.1 is an array of object"),
        ({1, 2}, r"state.agent.1 is a set"),
    ],
)
def test_what_is_not_data_is_refused_by_its_place(whole: Path, value: Any, message: str) -> None:
    before = whole.read_bytes()
    with pytest.raises(TypeError, match=message):
        save(whole, {"agent": [0, value]})
    assert whole.read_bytes() == before


def test_a_full_disk_leaves_the_last_checkpoint(whole: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    before = whole.read_bytes()

    def full(_: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.fsync", full)
    with pytest.raises(OSError, match="No space left"):
        save(whole, {"weights": np.zeros(10_000)})
    assert whole.read_bytes() == before
    assert list(whole.parent.iterdir()) == [whole]


def test_loading_runs_nothing(whole: Path) -> None:
    assert b"pickle" not in whole.read_bytes()
    source = Path(__file__).parent.parent / "sprl_bench" / "checkpoint.py"
    for word in ("pickle", "eval(", "exec(", "torch.load", "marshal"):
        assert word not in source.read_text()
