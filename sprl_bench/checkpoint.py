"""Checkpoints: nested state in one file, without executable content.

A safetensors file holds the arrays; its header holds, as JSON, the nesting, every other value, and a digest of it all.
It is one file, renamed into place, so no crash can mix two states. Mappings (with keys of any plain type), lists,
tuples, None, bool, int, float, str, NumPy arrays and scalars, and torch tensors keep their types.

Large arrays of bytes are compressed: they are the images that an agent remembers, about a gigabyte.
"""

from __future__ import annotations

import hashlib
import json
import math
import sys
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from sprl_bench.records import write_bytes
from sprl_bench.records.files import require_regular

FORMAT: Final = "1"
COMPRESSED_FROM: Final = 2**20
"""Bytes of an array of bytes from which on it is compressed."""

Array = npt.NDArray[Any]


class BrokenCheckpointError(ValueError):
    """A file that is not a whole checkpoint."""


def save(path: Path, state: Mapping[str, Any]) -> None:
    """Write `state` to `path`, whole or not at all.

    Raises:
        TypeError: The state holds something that is neither plain data nor an array; the message says where.
    """
    from safetensors.numpy import save as serialise  # noqa: PLC0415 - only where checkpoints are used

    arrays: dict[str, Array] = {}
    tree = json.dumps(_flatten(state, "", arrays))
    metadata = {"format": FORMAT, "tree": tree, "digest": _digest(tree, arrays)}
    write_bytes(path, serialise(arrays, metadata), own=True)


def load(path: Path) -> dict[str, Any]:
    """Read what `save` wrote.

    Raises:
        BrokenCheckpointError: The file is truncated, altered, or no checkpoint.
        InvalidFileError: It is no regular file.
        FileNotFoundError: There is no such file.
    """
    from safetensors import SafetensorError, safe_open  # noqa: PLC0415 - loaded when needed

    require_regular(path)
    path.open("rb").close()  # an error of the system is not a broken file
    try:
        with safe_open(path, framework="numpy") as file:
            metadata = file.metadata() or {}
            arrays: dict[str, Array] = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118 - no mapping
    except (SafetensorError, OSError) as error:
        raise BrokenCheckpointError(f"{path} is not a whole checkpoint: {error}") from None
    tree = metadata.get("tree", "")
    if metadata.get("format") != FORMAT or metadata.get("digest") != _digest(tree, arrays):
        raise BrokenCheckpointError(f"{path} is not a whole checkpoint of format {FORMAT}: its digest differs.")
    try:
        state = _restore(json.loads(tree), arrays)
    except (ValueError, KeyError, TypeError, ImportError, RecursionError, zlib.error):
        state = None
    if not isinstance(state, dict):
        raise BrokenCheckpointError(f"{path} is not a whole checkpoint of format {FORMAT}: its content is malformed.")
    return state


def _digest(tree: str, arrays: Mapping[str, Array]) -> str:
    digest = hashlib.sha256(tree.encode())
    for name in sorted(arrays):
        digest.update(f"{name}{arrays[name].dtype.str}{arrays[name].shape}".encode())
        digest.update(np.ascontiguousarray(arrays[name]).tobytes())
    return digest.hexdigest()


def _flatten(value: Any, place: str, arrays: dict[str, Array]) -> Any:
    """Return a JSON form of `value`: plain values unchanged, all others as [kind, content].

    Raises:
        TypeError: There is no such form.
    """
    if value is None or type(value) in (bool, int, float, str):
        return value
    if isinstance(value, Mapping):
        pairs = [
            [_flatten(key, place, arrays), _flatten(item, f"{place}.{key}", arrays)] for key, item in value.items()
        ]
        return ["mapping", pairs]
    if isinstance(value, list | tuple):
        kind = "list" if isinstance(value, list) else "tuple"
        return [kind, [_flatten(item, f"{place}.{index}", arrays) for index, item in enumerate(value)]]
    kind, array = _as_array(value, place)
    name = str(len(arrays))
    if array.dtype == np.uint8 and array.nbytes >= COMPRESSED_FROM:
        arrays[name] = np.frombuffer(zlib.compress(array.data, level=1), np.uint8)
        return ["compressed", [kind, name, list(array.shape)]]
    arrays[name] = array
    return [kind, name]


def _as_array(value: Any, place: str) -> tuple[str, Array]:
    torch = sys.modules.get("torch")  # if there are tensors, it is loaded
    if torch is not None and isinstance(value, torch.Tensor):
        tensor = value.detach().cpu().contiguous()
        if tensor.dtype is torch.bfloat16:
            return "bfloat16", tensor.view(torch.int16).numpy().copy()
        return "tensor", tensor.numpy().copy()
    if isinstance(value, np.ndarray | np.generic) and value.dtype.kind in "biuf":
        return "array" if isinstance(value, np.ndarray) else "scalar", np.array(value, order="C")
    kind = f"an array of {value.dtype}" if isinstance(value, np.ndarray) else f"a {type(value).__name__}"
    raise TypeError(f"state{place} is {kind}; a checkpoint takes plain values, numeric arrays and tensors.")


def _restore(value: Any, arrays: Mapping[str, Array]) -> Any:
    if not isinstance(value, list):
        return value
    kind, content = value
    if kind == "mapping":
        return {_restore(key, arrays): _restore(item, arrays) for key, item in content}
    if kind in ("list", "tuple"):
        items = [_restore(item, arrays) for item in content]
        return items if kind == "list" else tuple(items)
    if kind == "compressed":
        kind, name, shape = content
        return _from_array(kind, _decompressed(arrays[name], shape))
    return _from_array(kind, arrays[content])


def _decompressed(array: Array, shape: list[int]) -> Array:
    """Return the array of bytes of this shape.

    Raises:
        ValueError, zlib.error: The compressed bytes are not as many, or cannot be read.
    """
    content = zlib.decompressobj().decompress(array.data, math.prod(shape) + 1)  # no more memory than the shape says
    return np.frombuffer(bytearray(content), np.uint8).reshape(shape)


def _from_array(kind: str, array: Array) -> Any:
    if kind in ("array", "scalar"):
        return array if kind == "array" else array[()]
    import torch  # noqa: PLC0415 - only a state with tensors needs it

    tensor = torch.from_numpy(array)
    return tensor.view(torch.bfloat16) if kind == "bfloat16" else tensor
