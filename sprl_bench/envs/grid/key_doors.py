"""KeyDoors: fetch the key, open the locked door, walk to the goal."""

from __future__ import annotations

from typing import ClassVar

from minigrid.core.grid import Grid
from minigrid.core.world_object import Door, Goal, Key

from sprl_bench.envs.grid.grid_env import GridEnv
from sprl_bench.envs.grid.layouts import KEY_DOORS_DRAWS, key_doors_layout


class KeyDoors(GridEnv):
    """
    ## Description

    A square of S x S cells with an outer wall, cut in two by a vertical wall at a random column from 2 to S - 3.
    One cell of that wall, at a random row, is a locked yellow door. Agent (position and direction) and a yellow
    key start at distinct random cells to its left, the goal at a random cell to its right. Everything is drawn again
    for each episode.

    ## Mission Space

    "use the key to open the door, then walk to the green goal"

    ## Action Space

    | Num | Name    | Action                                                                      |
    |-----|---------|-----------------------------------------------------------------------------|
    | 0   | left    | Turn left                                                                   |
    | 1   | right   | Turn right                                                                  |
    | 2   | forward | Move to the cell in front, if it is empty, the goal or an open door         |
    | 3   | pickup  | Pick up the key in front                                                    |
    | 4   | drop    | Put the key down on the empty cell in front                                 |
    | 5   | toggle  | Unlock and open the door in front (with the key), or close or open it again |
    | 6   | done    | No effect                                                                   |

    ## Observation Encoding

    `Box(0, 255, (S, S, 3), uint8)`: the whole grid, indexed by row y, then column x. A cell holds
    (type, colour, state): empty (1, 0, 0), wall (2, 5, 0), key (5, 4, 0), goal (8, 1, 0), door (4, 4, s) with
    s = 0 open, 1 closed, 2 locked; the agent's cell holds (10, 0, direction) with 0 = right, 1 = down, 2 = left,
    3 = up. It is the image of Minigrid's `FullyObsWrapper` with its first two axes swapped. A carried key is not
    in the grid, and an open door is hidden while the agent stands in it.

    `info` holds `is_success` (bool) and `position`, the agent's (x, y) as an int64 array.

    ## Rewards

    `1 - 0.9 * t / 100` on reaching the goal at step t, counted from 1; otherwise 0.

    ## Termination

    1. Terminated: the agent reaches the goal.
    2. Truncated: step 100 was taken and did not reach the goal.

    ## Arguments

    - `render_mode`: None, `"rgb_array"` or `"human"`.
    - `observation`: `"cells"` (above); `"flat"`, the same numbers as `Box(0, 255, (3 * S * S,), uint8)`; or
      `"one-hot"`, `Box(0, 1, (11 * S * S,), float32)`, for each cell a 1 at the number of what is there: empty, wall,
      key, goal, open door, closed door, locked door, agent to the right, down, left, up. Task and score are the same.

    ## Registered Configurations

    - `SPRL/KeyDoors-7x7-v1`
    - `SPRL/KeyDoors-11x11-v1`

    ## Version history

    - v1: first version.
    """  # noqa: D212, D415 - the sections have Minigrid's form

    @staticmethod
    def _mission() -> str:
        return "use the key to open the door, then walk to the green goal"

    def _gen_grid(self, width: int, height: int) -> None:
        layout = key_doors_layout(width, self.np_random.random(KEY_DOORS_DRAWS).tolist())
        self.grid = Grid(width, height)
        self.grid.wall_rect(0, 0, width, height)
        self.grid.vert_wall(layout.wall_x, 0)
        self.put_obj(Door("yellow", is_locked=True), layout.wall_x, layout.door_y)
        self.put_obj(Key("yellow"), layout.key_x, layout.key_y)
        self.put_obj(Goal(), layout.goal_x, layout.goal_y)
        self.agent_pos, self.agent_dir = (layout.agent_x, layout.agent_y), layout.direction


class KeyDoors7x7(KeyDoors):
    """KeyDoors with S = 7."""

    size: ClassVar[int] = 7


class KeyDoors11x11(KeyDoors):
    """KeyDoors with S = 11."""

    size: ClassVar[int] = 11
