"""The films of the site: a row each, which `make_films.py` films and which the pages show.

Every picture says who acts: the exact solver, a trained agent with its run, or a policy that fails.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final


@dataclass(frozen=True)
class Film:
    """A film.

    Attributes:
        name: Of its file in `docs/films`, without the suffix.
        family: The page that shows it.
        env_id: What is filmed.
        policy: `random`, `solver`, a script of `make_films.py`, or the path of a run below the folder of
            all runs.
        title: Who acts.
        caption: How it was made.
        seed: Of the environment and of a random policy.
        episodes: At most how many, one after the other.
        steps: At most how many, over all episodes.
        stride: One frame is kept of so many steps.
        width: Pixels.
        colours: Of the palette.
        crop: Left, upper, right and lower edge of what is shown; None for all.
        arguments: Of the environment, besides those of a run.
    """

    name: str
    family: str
    env_id: str
    policy: str
    title: str
    caption: str
    seed: int = 0
    episodes: int = 3
    steps: int = 90
    stride: int = 1
    width: int = 224
    colours: int = 32
    crop: tuple[int, int, int, int] | None = None
    arguments: Mapping[str, int] = field(default_factory=dict, hash=False)

    @property
    def path(self) -> str:
        """Its file, below the root of the repository."""
        return f"docs/films/{self.name}.gif"


GRIDS: Final = "grids"
FETCH: Final = "fetch"
MAZES: Final = "mazes"
ATARI: Final = "atari"

FOUR_ROOMS: Final = "SPRL/FourRooms-7x7-v1"
KEY_DOORS: Final = "SPRL/KeyDoors-7x7-v1"
REACH: Final = "SPRL/FetchReachSparse-v1"
ROBOT: Final = (60, 80, 390, 410)  # of its picture
MAZE: Final = "SPRL/MazeGoalSmall-v1"
GAME: Final = "SPRL/MontezumaRevenge-v1"

FILMS: Final = (
    Film(
        "four-rooms-solver",
        GRIDS,
        FOUR_ROOMS,
        "solver",
        "The solver",
        "FourRooms-7x7, seed 0, on shortest paths.",
        episodes=4,
    ),
    Film(
        "four-rooms-ppo",
        GRIDS,
        FOUR_ROOMS,
        "grid-7x7/FourRooms-7x7/ppo/seed-0",
        "A trained agent",
        "FourRooms-7x7: `ppo`, seed 0, after the 500,000 steps of the suite `grid-7x7`.",
        episodes=4,
    ),
    Film(
        "four-rooms-random",
        GRIDS,
        FOUR_ROOMS,
        "random",
        "Random actions",
        "FourRooms-7x7, seed 0; the episode ends at step 100.",
        episodes=1,
        steps=100,
    ),
    Film(
        "key-doors-solver",
        GRIDS,
        KEY_DOORS,
        "solver",
        "The solver",
        "KeyDoors-7x7, seed 0, on shortest paths.",
        episodes=3,
    ),
    Film(
        "key-doors-gt-grid",
        GRIDS,
        KEY_DOORS,
        "grid-7x7/KeyDoors-7x7/gt-grid@tuned/seed-0",
        "A trained agent",
        "KeyDoors-7x7: `gt-grid@tuned` †, seed 0, after the 2,000,000 steps of the suite `grid-7x7`. † It trained with "
        "a bonus from its true position.",
        episodes=3,
    ),
    Film(
        "key-doors-random",
        GRIDS,
        KEY_DOORS,
        "random",
        "Random actions",
        "KeyDoors-7x7, seed 0; the episode ends at step 100.",
        episodes=1,
        steps=100,
    ),
    Film(
        "reach-script",
        FETCH,
        REACH,
        "towards_goal",
        "A script",
        "FetchReach, substep 5, seed 0: a hand-written rule that moves the gripper straight to the goal. There is no "
        "solver for these tasks.",
        arguments={"substep": 5},
        stride=3,
        episodes=4,
        width=224,
        crop=ROBOT,
        colours=48,
    ),
    Film(
        "reach-ppo",
        FETCH,
        REACH,
        "fetch-sparse/FetchReach-substep2/ppo/seed-0",
        "A trained agent",
        "FetchReach-substep2: `ppo`, seed 0, after the 1,000,000 steps of the suite `fetch-sparse`.",
        stride=7,
        episodes=4,
        steps=200,
        width=224,
        crop=ROBOT,
        colours=48,
    ),
    Film(
        "reach-random",
        FETCH,
        REACH,
        "random",
        "Random actions",
        "FetchReach, substep 5, seed 0.",
        arguments={"substep": 5},
        stride=6,
        episodes=1,
        steps=200,
        width=224,
        crop=ROBOT,
        colours=48,
    ),
    Film(
        "maze-solver",
        MAZES,
        MAZE,
        "solver",
        "The solver",
        "MazeGoalSmall, seed 4: what the agent sees, and the maze from above, which it does not see.",
        seed=4,
        episodes=1,
        steps=74,
        stride=3,
        width=280,
        colours=64,
    ),
    Film(
        "maze-gt-grid",
        MAZES,
        MAZE,
        "custom/MazeGoalSmall-1200000/gt-grid/seed-120",
        "A trained agent",
        "MazeGoalSmall: `gt-grid` †, seed 120, after 1,200,000 steps; 4.75 goals an episode in the last tenth of them. "
        "Seed 5 of the environment: of 4, 5, 6, ... the first with a goal in 150 steps. † It trained with a bonus from "
        "its true position.",
        seed=5,
        episodes=1,
        steps=108,
        stride=3,
        width=280,
        colours=64,
    ),
    Film(
        "maze-random",
        MAZES,
        MAZE,
        "random",
        "Random actions",
        "MazeGoalSmall, seed 4.",
        seed=4,
        episodes=1,
        steps=74,
        stride=3,
        width=280,
        colours=64,
    ),
    Film(
        "freeway-script",
        ATARI,
        "SPRL/Freeway-v1",
        "always_up",
        "A script",
        "Freeway, seed 0: always up, the first 300 steps. Each crossing is a point; the whole episode has 26. There is "
        "no solver for these games.",
        episodes=1,
        steps=300,
        stride=4,
        width=160,
        colours=32,
    ),
    Film(
        "pacman-ppo",
        ATARI,
        "SPRL/MsPacman-v1",
        "custom/MsPacman-300000/ppo/seed-120",
        "A trained agent",
        "MsPacman: `ppo`, seed 120, after 300,000 steps, the first 300 of an episode.",
        episodes=1,
        steps=300,
        stride=4,
        width=160,
        colours=32,
    ),
    Film(
        "atari-random",
        ATARI,
        GAME,
        "random",
        "Random actions",
        "MontezumaRevenge, seed 0.",
        episodes=1,
        steps=300,
        stride=4,
        width=160,
        colours=32,
    ),
)
MISSING: Final = {
    MAZES: "No run of the whole suite yet: 20 million steps a task take a GPU.",
    ATARI: "No run of the whole suite yet: 12 million steps a game take a GPU.",
}
"""What a family has no film of, and why."""
