"""Where an agent is, in whole steps of one action, and the picture of the place: grids, Fetch, Montezuma's Revenge."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np

from sprl_bench.scores import Array

Place = tuple[int, int]

STEP: Final = 3
"""Pixels along a side of a place on an Atari screen: about what a walking agent moves during one action."""
_MONTEZUMA: Final = "SPRL/MontezumaRevenge-v1"
_ROOM, _X, _Y = 0x83, 0xAA, 0xAB  # addresses in the console's memory, which begins at 0x80
_BOTTOM: Final = 318  # the height that the console counts is 0 in this row of the screen


def place_of(env: Any, observation: Any, info: Mapping[str, Any]) -> Place:
    """Return the agent's place (x, y): a cell on grids, 2 cm wide on Fetch, `STEP` pixels wide on a screen."""
    if has_screen(env):
        x, y = _memory(env, _X), _BOTTOM - _memory(env, _Y)
        return x // STEP, y // STEP
    if "position" in info:
        x, y = info["position"]
        return int(x), int(y)
    x, y = np.floor(np.asarray(observation[:2]) / 0.02)
    return int(x), int(y)


def room_of(env: Any) -> int:
    """Return the number of the room that the agent is in; 0 where there are no rooms."""
    return _memory(env, _ROOM) if has_screen(env) else 0


def screen_of(env: Any) -> Array:
    """Return the screen of an Atari game in grey, [210, 160]."""
    grey: Array = np.asarray(env.unwrapped.screen().picture()).mean(axis=-1)
    return grey


def has_screen(env: Any) -> bool:
    """Return whether places are on a screen.

    Raises:
        ValueError: They are on one of a game whose memory is not known here.
    """
    if not hasattr(env.unwrapped, "screen"):
        return False
    if env.spec.id != _MONTEZUMA:
        raise ValueError(f"The game is {env.spec.id}; it must be {_MONTEZUMA}, the only one with known positions.")
    return True


def _memory(env: Any, address: int) -> int:
    return int(env.unwrapped.screen().memory()[address - 0x80])
