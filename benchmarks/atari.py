"""The batched Atari engine, through the recorder, against ale-py's own vector environment.

Both take the same random actions and go through whole episodes, resets included.
"""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np

from benchmarks.contenders import contender
from benchmarks.measure import Row, compare
from benchmarks.turns import Turn
from sprl_bench.envs.atari.preprocessing import MOST_NO_OPS, NUM_ACTIONS
from sprl_bench.recorder import VectorRecorder

NUM_ENVS, NUM_THREADS, STEPS = 12, 1, 500
GAMES = {"MsPacman": "ms_pacman", "Freeway": "freeway"}  # ours, and ale-py's name
BAR = 0.95


def rows() -> list[Row]:
    """Measure all rows; takes about a minute on an idle machine."""
    return [
        compare(
            f"{game}, recorded, N={NUM_ENVS}, {NUM_THREADS} thread",
            contender(ours, game=game),
            "ale-py's AtariVectorEnv",
            contender(theirs, game=game),
            bar=BAR,
            repeats=5,
        )
        for game in GAMES
    ]


def ours(game: str) -> Turn:
    """Return turns of our engine under a recorder."""
    envs = gymnasium.make_vec(f"SPRL/{game}-v1", NUM_ENVS, num_threads=NUM_THREADS)
    return stepper(VectorRecorder(envs, 10**9))


def theirs(game: str) -> Turn:
    """Return turns of ale-py's vector environment with the same settings."""
    import ale_py  # noqa: PLC0415 - an extra

    envs: Any = ale_py.AtariVectorEnv(
        GAMES[game],
        NUM_ENVS,
        num_threads=NUM_THREADS,
        autoreset_mode="SameStep",
        full_action_space=True,
        noop_max=MOST_NO_OPS + 1,
        reward_clipping=False,
        use_fire_reset=False,
    )
    return stepper(envs)


def stepper(envs: Any) -> Turn:
    """Return turns of `STEPS` random actions in each sub-environment."""
    envs.reset(seed=0)
    actions = np.random.default_rng(0).integers(0, NUM_ACTIONS, (STEPS, NUM_ENVS))

    def turn() -> int:
        for row in actions:
            envs.step(row)
        return STEPS * NUM_ENVS

    return turn
