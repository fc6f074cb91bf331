"""Random streams stored as arrays: exactly NumPy's PCG64, with one row of 64-bit limbs for each stream.

A stream seeded with s gives the same numbers as `gymnasium.utils.seeding.np_random(s)`, so an engine's sub-environment
draws the same doubles as a single environment. A row is [state high, state low, increment high, increment low].

References: O'Neill, "PCG: A Family of Simple Fast Space-Efficient Statistically Good Algorithms for Random Number
Generation", 2014 (PCG XSL RR 128/64); NumPy's documentation of `SeedSequence`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from sprl_bench.envs.compiled import inline, kernel

STREAM_LIMBS: Final = 4

_MULTIPLIER_HIGH: Final = np.uint64(0x2360ED051FC65DA4)
_MULTIPLIER_LOW: Final = np.uint64(0x4385DF649FCCF645)
_LOW_HALF: Final = np.uint64(0xFFFFFFFF)
_0, _1, _11, _32, _58, _63, _64 = (np.uint64(value) for value in (0, 1, 11, 32, 58, 63, 64))

# SeedSequence: a pool of four 32-bit words, hashed with these.
_POOL_WORDS: Final = 4
_HASH_START, _HASH_FACTOR = np.uint32(0x43B0D7E5), np.uint32(0x931E8875)
_OUTPUT_START, _OUTPUT_FACTOR = np.uint32(0x8B51F9DD), np.uint32(0x58F38DED)
_MIX_LEFT, _MIX_RIGHT = np.uint32(0xCA01F9DD), np.uint32(0x4973F715)
_HALF_WORD: Final = np.uint32(16)


@inline
def _high_product(left: np.uint64, right: np.uint64) -> np.uint64:
    """Return the upper 64 bits of a 64 x 64 bit product."""
    left_low, left_high = left & _LOW_HALF, left >> _32
    right_low, right_high = right & _LOW_HALF, right >> _32
    middle = left_high * right_low + ((left_low * right_low) >> _32)
    other = left_low * right_high + (middle & _LOW_HALF)
    return left_high * right_high + (middle >> _32) + (other >> _32)


@inline
def _advance(stream: NDArray[np.uint64]) -> None:
    """Take one step of the generator: state <- state * multiplier + increment, modulo 2**128."""
    high, low = stream[0], stream[1]
    product_low = low * _MULTIPLIER_LOW
    product_high = _high_product(low, _MULTIPLIER_LOW) + high * _MULTIPLIER_LOW + low * _MULTIPLIER_HIGH
    stream[1] = product_low + stream[3]
    carry = _1 if stream[1] < product_low else _0
    stream[0] = product_high + stream[2] + carry


@inline
def next_double(stream: NDArray[np.uint64]) -> float:
    """Return the stream's next double in [0, 1): the top 53 bits of its next 64."""
    _advance(stream)
    mixed = stream[0] ^ stream[1]
    turn = stream[0] >> _58
    bits = (mixed >> turn) | (mixed << ((_64 - turn) & _63))
    return float(bits >> _11) * (1.0 / 9007199254740992.0)


@kernel
def fill_doubles(stream: NDArray[np.uint64], out: NDArray[np.float64]) -> None:
    """Fill `out` [K] with the stream's next doubles, like `Generator.random(K)`."""
    for index in range(out.shape[0]):
        out[index] = next_double(stream)


@inline
def _mix(left: np.uint32, right: np.uint32) -> np.uint32:
    """Combine two words of the pool."""
    result = np.uint32(np.uint32(_MIX_LEFT * left) - np.uint32(_MIX_RIGHT * right))
    return np.uint32(result ^ (result >> _HALF_WORD))


@inline
def _hash(value: np.uint32, constant: np.uint32, factor: np.uint32) -> np.uint32:
    """Hash one word; the caller multiplies `constant` by `factor` after each use."""
    result = np.uint32(np.uint32(value ^ constant) * np.uint32(constant * factor))
    return np.uint32(result ^ (result >> _HALF_WORD))


@inline
def _fill_pool(words: NDArray[np.uint32], pool: NDArray[np.uint32]) -> None:
    """Mix a seed of four words into the pool."""
    constant = _HASH_START
    for index in range(_POOL_WORDS):
        pool[index] = _hash(words[index], constant, _HASH_FACTOR)
        constant = np.uint32(constant * _HASH_FACTOR)
    for source in range(_POOL_WORDS):
        for target in range(_POOL_WORDS):
            if source != target:
                pool[target] = _mix(pool[target], _hash(pool[source], constant, _HASH_FACTOR))
                constant = np.uint32(constant * _HASH_FACTOR)


@inline
def _start(stream: NDArray[np.uint64], pool: NDArray[np.uint32], start: NDArray[np.uint64]) -> None:
    """Set a stream from a filled pool; `start` [4] is scratch space."""
    constant = _OUTPUT_START
    start[:] = _0
    for index in range(2 * STREAM_LIMBS):
        word = _hash(pool[index % _POOL_WORDS], constant, _OUTPUT_FACTOR)
        constant = np.uint32(constant * _OUTPUT_FACTOR)
        start[index // 2] |= np.uint64(word) << np.uint64(32 * (index % 2))
    stream[0], stream[1] = _0, _0
    stream[2] = (start[2] << _1) | (start[3] >> _63)
    stream[3] = (start[3] << _1) | _1
    _advance(stream)
    low = stream[1] + start[1]
    stream[0] += start[0] + (_1 if low < start[1] else _0)
    stream[1] = low
    _advance(stream)


@kernel
def _seed_all(streams: NDArray[np.uint64], rows: NDArray[np.int64], words: NDArray[np.uint32]) -> None:
    """Seed the streams [rows] from their seeds' words [len(rows), 4]."""
    pool = np.empty(_POOL_WORDS, np.uint32)
    start = np.empty(STREAM_LIMBS, np.uint64)
    for index in range(rows.shape[0]):
        _fill_pool(words[index], pool)
        _start(streams[rows[index]], pool, start)


def seed_streams(streams: NDArray[np.uint64], rows: NDArray[np.int64], seeds: list[int]) -> None:
    """Seed `streams[rows]` like `numpy.random.PCG64`, each with its own non-negative integer."""
    if max(seeds, default=0) < 2 ** (32 * _POOL_WORDS):
        packed = b"".join(seed.to_bytes(4 * _POOL_WORDS, "little") for seed in seeds)
        _seed_all(streams, rows, np.frombuffer(packed, "<u4").reshape(-1, _POOL_WORDS).copy())
    else:  # more words than the pool holds: rare, so NumPy does it
        for row, seed in zip(rows, seeds, strict=True):
            streams[row] = from_generator(np.random.Generator(np.random.PCG64(seed)))


def from_generator(generator: np.random.Generator) -> NDArray[np.uint64]:
    """Return the row of a PCG64 generator."""
    state = generator.bit_generator.state["state"]
    limbs = [limb for key in ("state", "inc") for limb in divmod(int(state[key]), 2**64)]
    return np.array(limbs, dtype=np.uint64)


def from_generators(generators: Sequence[np.random.Generator]) -> NDArray[np.uint64]:
    """Return the rows of N PCG64 generators, [N, STREAM_LIMBS]."""
    return np.stack([from_generator(generator) for generator in generators])


def to_generator(stream: NDArray[np.uint64]) -> np.random.Generator:
    """Return a generator that continues the stream of a row, without changing the row."""
    state_high, state_low, increment_high, increment_low = (int(limb) for limb in stream)
    bit_generator = np.random.PCG64(0)
    bit_generator.state = {
        "bit_generator": "PCG64",
        "state": {
            "state": (state_high << 64) | state_low,
            "inc": (increment_high << 64) | increment_low,
        },
        "has_uint32": 0,
        "uinteger": 0,
    }
    return np.random.Generator(bit_generator)


def to_generators(streams: NDArray[np.uint64]) -> list[np.random.Generator]:
    """Return generators that continue the streams of N rows [N, STREAM_LIMBS]."""
    return [to_generator(stream) for stream in streams]
