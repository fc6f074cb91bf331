"""The environment ids, and their registration with Gymnasium.

This package only imports Gymnasium: entry points are strings, imported when an environment is made. So specs can be
serialised to JSON, and `import sprl_bench` is fast.
"""

from __future__ import annotations

import gymnasium

__all__ = ["ATARI_IDS", "FETCH_IDS", "GRID_IDS", "IDS", "MAZE_IDS", "register"]

_GRID = "sprl_bench.envs.grid"
_FETCH = "sprl_bench.envs.fetch"
_MAZE = "sprl_bench.envs.maze"
_ATARI = "sprl_bench.envs.atari"

# id -> (entry point of the single environment, entry point of the batched engine)
_GRID_TABLE: dict[str, tuple[str, str]] = {
    "SPRL/FourRooms-7x7-v1": (f"{_GRID}.four_rooms:FourRooms7x7", f"{_GRID}.grid_engine:FourRooms7x7Engine"),
    "SPRL/FourRooms-11x11-v1": (f"{_GRID}.four_rooms:FourRooms11x11", f"{_GRID}.grid_engine:FourRooms11x11Engine"),
    "SPRL/KeyDoors-7x7-v1": (f"{_GRID}.key_doors:KeyDoors7x7", f"{_GRID}.grid_engine:KeyDoors7x7Engine"),
    "SPRL/KeyDoors-11x11-v1": (f"{_GRID}.key_doors:KeyDoors11x11", f"{_GRID}.grid_engine:KeyDoors11x11Engine"),
}
_FETCH_TABLE: dict[str, tuple[str, str]] = {
    "SPRL/FetchReachSparse-v1": (f"{_FETCH}.fetch_env:reach", f"{_FETCH}.fetch_engine:reach"),
    "SPRL/FetchPushSparse-v1": (f"{_FETCH}.fetch_env:push", f"{_FETCH}.fetch_engine:push"),
    "SPRL/FetchSlideSparse-v1": (f"{_FETCH}.fetch_env:slide", f"{_FETCH}.fetch_engine:slide"),
    "SPRL/FetchPickAndPlaceSparse-v1": (f"{_FETCH}.fetch_env:pick_and_place", f"{_FETCH}.fetch_engine:pick_and_place"),
}
_ATARI_TABLE: dict[str, tuple[str, str]] = {
    f"SPRL/{game}-v1": (f"{_ATARI}.atari_env:{game}", f"{_ATARI}.atari_engine:{game}Engine")
    for game in ("MontezumaRevenge", "Freeway", "MsPacman", "Gravitar", "Seaquest", "Hero")
}

_MAZE_TABLE: dict[str, tuple[str, str]] = {
    "SPRL/MazeGoalSmall-v1": (f"{_MAZE}.maze_env:MazeGoalSmall", f"{_MAZE}.maze_engine:MazeGoalSmallEngine"),
    "SPRL/MazeGoalLarge-v1": (f"{_MAZE}.maze_env:MazeGoalLarge", f"{_MAZE}.maze_engine:MazeGoalLargeEngine"),
    "SPRL/MazeObjectMany-v1": (f"{_MAZE}.maze_env:MazeObjectMany", f"{_MAZE}.maze_engine:MazeObjectManyEngine"),
}

_TABLE = _GRID_TABLE | _FETCH_TABLE | _MAZE_TABLE | _ATARI_TABLE

GRID_IDS: tuple[str, ...] = tuple(_GRID_TABLE)
FETCH_IDS: tuple[str, ...] = tuple(_FETCH_TABLE)
MAZE_IDS: tuple[str, ...] = tuple(_MAZE_TABLE)
ATARI_IDS: tuple[str, ...] = tuple(_ATARI_TABLE)
IDS: tuple[str, ...] = tuple(_TABLE)
"""Every environment id, in the order of the protocol's table."""


def register() -> None:
    """Register all `IDS` with `gymnasium.make` and `gymnasium.make_vec`; a second call has no effect.

    No id has `max_episode_steps`: each environment truncates its episodes itself.
    """
    for env_id, (entry_point, vector_entry_point) in _TABLE.items():
        if env_id not in gymnasium.registry:
            gymnasium.register(env_id, entry_point, vector_entry_point=vector_entry_point)
