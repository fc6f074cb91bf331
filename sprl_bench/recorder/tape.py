"""The tape of a run: every action and every reset, in their order, so that the environment alone can repeat the run.

A tape is one line of JSON, its head, and then blocks: a letter, the length of the content, and the content, compressed.
`S` holds the actions of successive steps of all sub-environments, `E` those of single environments with the index of
each, `R` one reset, and `C` that a single environment was closed. A discrete action takes as few bits as its number
needs; others are stored with the type of their space.
"""

from __future__ import annotations

import json
import math
import struct
import zlib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated, Any, BinaryIO, Final, Literal, NamedTuple

import numpy as np
import numpy.typing as npt
from gymnasium import spaces
from gymnasium.vector import AutoresetMode, VectorEnv
from pydantic import Field, TypeAdapter, ValidationError

from sprl_bench.records import Data
from sprl_bench.records.files import first_complaint
from sprl_bench.records.places import find_duplicate

Array = npt.NDArray[Any]

FORMAT: Final = 1
BLOCK: Final = struct.Struct("<cI")  # letter and length
PENDING: Final = 4_096  # calls of step in one block
LARGEST: Final = 2**28  # bytes of a block
LARGEST_HEAD: Final = 2**16  # bytes of the first line
MOST_ENVS: Final = 2**20


class UnfitForTapeError(ValueError):
    """Actions of this space, or this file, cannot be a tape."""


class Head(Data):
    """What is the same for all of a tape.

    Attributes:
        num_envs: Sub-environments of a vector environment; 0 for single environments.
        autoreset: A vector environment's mode, "" for single environments.
        discrete: The number of actions, 0 for a box.
        shape: The shape of one action.
        dtype: The type of a box's components.
    """

    num_envs: Annotated[int, Field(ge=0, le=MOST_ENVS)]
    autoreset: Literal["", "NextStep", "SameStep", "Disabled"]
    discrete: Annotated[int, Field(ge=0, lt=2**31)]
    shape: Annotated[tuple[Annotated[int, Field(gt=0, le=4_096)], ...], Field(strict=False, max_length=8)] = ()
    dtype: Literal["float16", "float32", "float64", "int8", "int16", "int32", "int64", "uint8", "bool"] = "float32"
    format: int = FORMAT

    @classmethod
    def of(cls, space: spaces.Space[Any], num_envs: int = 0, autoreset: str = "") -> Head:
        """Return the head for the action space of one sub-environment.

        Raises:
            UnfitForTapeError: The space is neither `Discrete` from 0 nor a `Box`.
        """
        if isinstance(space, spaces.Discrete) and space.start == 0:
            return cls._made(num_envs=num_envs, autoreset=autoreset, discrete=int(space.n))
        if isinstance(space, spaces.Box):
            shape, dtype = tuple(map(int, space.shape)), np.dtype(space.dtype).name
            return cls._made(num_envs=num_envs, autoreset=autoreset, discrete=0, shape=shape, dtype=dtype)
        raise UnfitForTapeError(f"action_space is {space}; it must be Discrete from 0 or a Box for actions to be kept.")

    @classmethod
    def _made(cls, **fields: Any) -> Head:
        try:
            return cls(**fields)
        except ValidationError as error:
            raise UnfitForTapeError(f"These actions cannot be kept: {first_complaint(error)}.") from None

    @classmethod
    def of_envs(cls, envs: VectorEnv[Any, Any, Any]) -> Head:
        """Return the head for a vector environment."""
        mode = AutoresetMode(envs.metadata["autoreset_mode"]).value
        return cls.of(envs.single_action_space, envs.num_envs, mode)

    @property
    def bits(self) -> int:
        """Bits of one discrete action."""
        return max(1, math.ceil(math.log2(self.discrete)))

    def pack(self, actions: Array) -> bytes:
        """Return actions [A, ...] as bytes.

        Raises:
            UnfitForTapeError: A discrete action is not an integer of the space.
        """
        if not self.discrete:
            return np.ascontiguousarray(actions, self.dtype).tobytes()
        numbers = np.asarray(actions).reshape(-1)
        if ((numbers < 0) | (numbers >= self.discrete)).any():
            raise UnfitForTapeError(f"An action is outside of 0 to {self.discrete - 1}, so it cannot be kept.")
        digits = numbers.astype(np.int64)[:, None] >> np.arange(self.bits) & 1
        return struct.pack("<Q", len(numbers)) + np.packbits(digits.astype(np.uint8)).tobytes()

    def unpack(self, content: bytes) -> Array:
        """Return the actions [A, ...] of such bytes."""
        if not self.discrete:
            return np.frombuffer(content, self.dtype).reshape(-1, *self.shape)
        (count,) = struct.unpack_from("<Q", content)
        if count * self.bits > 8 * len(content):
            raise ValueError(f"it has {count} actions in {len(content)} bytes")
        digits = np.unpackbits(np.frombuffer(content, np.uint8, offset=8), count=count * self.bits)
        weights = 1 << np.arange(self.bits)
        numbers: Array = (digits.reshape(count, self.bits) * weights).sum(axis=1)
        return numbers


class Reset(NamedTuple):
    """A call of `reset`."""

    env: int  # index of a single environment; -1 for a vector environment
    seed: int | list[int | None] | None
    mask: list[bool] | None  # which sub-environments; None for all


class Close(NamedTuple):
    """A single environment was closed."""

    env: int


class Steps(NamedTuple):
    """Successive steps: actions [A, ...]; envs [A] are the indices of single environments, None for a vector one."""

    actions: Array
    envs: Array | None


Event = Reset | Close | Steps
Index = Annotated[int, Field(ge=-1, lt=2**32)]
Seed = Annotated[int, Field(ge=0)]
WrittenReset: Final = TypeAdapter(tuple[Index, Seed | list[Seed | None] | None, list[bool] | None])
WrittenClose: Final = TypeAdapter(tuple[Annotated[int, Field(ge=0, lt=2**32)]])


class NoTape:
    """Keeps nothing."""

    def step(self, actions: Any, env: int = -1) -> None:
        """Ignore the actions of one call of `step`."""

    def reset(self, seed: Any, mask: Any = None, env: int = -1) -> None:
        """Ignore one call of `reset`."""

    def close(self, env: int) -> None:
        """Ignore that a single environment was closed."""

    def flush(self) -> int:
        """Write nothing; return 0."""
        return 0


class Tape(NoTape):
    """Writes a tape.

    Args:
        file: Open for writing bytes, at its beginning or, to continue, at the end of a block.
        head: Written if the file is at its beginning.
    """

    def __init__(self, file: BinaryIO, head: Head) -> None:
        self._file, self._head = file, head
        self._actions: list[Array] = []
        self._envs: list[int] = []
        if file.tell() == 0:
            file.write(json.dumps(head.model_dump(mode="json")).encode() + b"\n")

    def step(self, actions: Any, env: int = -1) -> None:
        """Keep the actions of one call of `step`: of a vector environment [N, ...], or of the single one `env`."""
        self._actions.append(np.array(actions))
        self._envs.append(env)
        if len(self._actions) >= PENDING:
            self.flush()

    def reset(self, seed: Any, mask: Any = None, env: int = -1) -> None:
        """Keep one call of `reset`."""
        self.flush()
        which = None if mask is None else np.asarray(mask, np.bool_).tolist()
        self._write(b"R", json.dumps(Reset(env, _plain(seed), which)).encode())

    def close(self, env: int) -> None:
        """Keep that a single environment was closed."""
        self.flush()
        self._write(b"C", json.dumps(Close(env)).encode())

    def flush(self) -> int:
        """Write everything, and return the size of the file in bytes."""
        if self._actions:
            packed = self._head.pack(np.stack(self._actions))
            if self._head.num_envs:
                self._write(b"S", packed)
            else:
                envs = np.asarray(self._envs, np.uint32)
                self._write(b"E", struct.pack("<I", len(envs)) + envs.tobytes() + packed)
            self._actions, self._envs = [], []
        self._file.flush()
        return self._file.tell()

    def _write(self, letter: bytes, content: bytes) -> None:
        compressed = zlib.compress(content, 1)
        self._file.write(BLOCK.pack(letter, len(compressed)) + compressed)


def _plain(seed: Any) -> Any:
    if isinstance(seed, Sequence | np.ndarray):
        return [None if one is None else int(one) for one in seed]
    return None if seed is None else int(seed)


def read_tape(path: Path) -> tuple[Head, Iterator[Event]]:
    """Return the head of a tape and its events, in their order.

    Raises:
        UnfitForTapeError: The file is not a tape, or is broken; for later blocks, while they are read.
    """
    with path.open("rb") as file:
        line = file.readline(LARGEST_HEAD + 1)
    if len(line) > LARGEST_HEAD:
        raise UnfitForTapeError(f"{path} does not begin like a tape: its head has more than {LARGEST_HEAD:,} bytes.")
    try:
        head = Head.model_validate_json(line)
    except ValidationError as error:
        raise UnfitForTapeError(f"{path} does not begin like a tape of actions: {first_complaint(error)}.") from None
    if twice := find_duplicate(line.decode()):
        raise UnfitForTapeError(f"{path} does not begin like a tape of actions: {twice[-1]} is given twice.")
    if head.format != FORMAT:
        raise UnfitForTapeError(f"{path} has the format {head.format}; it must be {FORMAT}.")
    return head, _events(path, head, len(line))


def _events(path: Path, head: Head, offset: int) -> Iterator[Event]:
    """Yield the events behind a head of `offset` bytes; one block at a time is in memory."""
    with path.open("rb") as file:
        file.seek(offset)
        left = path.stat().st_size - offset
        while left > 0:
            try:
                letter, length = BLOCK.unpack(file.read(BLOCK.size))
                event = _event(head, letter, _inflate(file.read(min(length, LARGEST))))
            except (struct.error, zlib.error, ValueError, TypeError) as error:
                said = first_complaint(error) if isinstance(error, ValidationError) else str(error)
                raise UnfitForTapeError(f"{path} has a broken block, {left} bytes before its end: {said}.") from None
            yield event
            left -= BLOCK.size + length


def _inflate(compressed: bytes) -> bytes:
    """Return the content of a block, at most `LARGEST` bytes: a hostile file may expand a thousandfold."""
    inflater = zlib.decompressobj()
    content = inflater.decompress(compressed, LARGEST)
    if not inflater.eof:
        raise ValueError("a block is cut off or too large")
    if inflater.unused_data:
        raise ValueError("a block has more than its content")
    return content


def _event(head: Head, letter: bytes, content: bytes) -> Event:
    kind = letter.decode("ascii", "replace")
    if kind == "R":
        return Reset(*WrittenReset.validate_json(content))
    if kind == "C":
        return Close(*WrittenClose.validate_json(content))
    if kind == "S" and head.num_envs:
        actions = head.unpack(content)
        return Steps(actions.reshape(-1, head.num_envs, *head.shape), None)
    if kind == "E" and not head.num_envs:
        (count,) = struct.unpack_from("<I", content)
        envs = np.frombuffer(content, np.uint32, count, 4)
        return Steps(head.unpack(content[4 + 4 * count :]), envs)
    raise ValueError(f"a block is of the unknown kind {kind!r}")
