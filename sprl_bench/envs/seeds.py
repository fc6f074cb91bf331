"""Seeds of N sub-environments: checks of the argument of `reset`, and storage as an array."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

_LIMB: Final = 64
_LEAST_LIMBS: Final = 2  # a random seed has 128 bits


def checked_seeds(seed: Any, rows: NDArray[np.int64], num_envs: int) -> list[int | None]:
    """Return one seed, or None, for each of `rows`.

    Args:
        seed: The argument of `reset`: an int (row i gets `seed + i`), one entry for each sub-environment, or None.
        rows: The sub-environments that are reset.
        num_envs: Number of sub-environments N.

    Raises:
        TypeError: `seed` is none of these.
        ValueError: There are not N entries, or an entry of `rows` is not a non-negative int or None.
    """
    if seed is None:
        return [None] * len(rows)
    seeds = [seed + row for row in range(num_envs)] if isinstance(seed, int) else seed
    if not isinstance(seeds, Sequence) or isinstance(seeds, str):
        raise TypeError(f"seed is {seed!r}; it must be an int, None, or a list of num_envs ints or None.")
    if len(seeds) != num_envs:
        raise ValueError(f"seed has {len(seeds)} entries; it must have one for each of {num_envs} sub-environments.")
    chosen = [seeds[row] for row in rows]
    for value in chosen:
        if value is not None and not (isinstance(value, int) and value >= 0):
            raise ValueError(f"seed has the entry {value!r}; it must be a non-negative int or None.")
    return chosen


def random_seed() -> int:
    """Return a seed from the operating system's entropy, as Gymnasium does if no seed is given."""
    entropy = np.random.SeedSequence().entropy
    assert isinstance(entropy, int)
    return entropy


def pack_seeds(seeds: Sequence[int]) -> NDArray[np.uint64]:
    """Return seeds of any size as uint64 [N, L], lowest limb first, with L >= 2 limbs for the largest seed."""
    num_limbs = max(_LEAST_LIMBS, *(-(-seed.bit_length() // _LIMB) for seed in seeds))
    limbs = [[seed >> (_LIMB * place) & (2**_LIMB - 1) for place in range(num_limbs)] for seed in seeds]
    return np.array(limbs, np.uint64)


def unpack_seeds(packed: NDArray[np.uint64]) -> list[int]:
    """Return the seeds that `pack_seeds` packed."""
    return [sum(limb << (_LIMB * place) for place, limb in enumerate(limbs)) for limbs in packed.tolist()]
