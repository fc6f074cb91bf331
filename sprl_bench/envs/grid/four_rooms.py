"""FourRooms: four rooms connected by gaps, with a goal in one of them."""

from __future__ import annotations

from typing import ClassVar

from minigrid.core.grid import Grid
from minigrid.core.world_object import Goal

from sprl_bench.envs.grid.grid_env import GridEnv
from sprl_bench.envs.grid.layouts import FOUR_ROOMS_DRAWS, four_rooms_layout


class FourRooms(GridEnv):
    """
    ## Description

    A square of S x S cells with an outer wall and a cross of walls at S // 2, which forms four rooms. Each of the
    cross's four arms has one gap, at a random cell. Agent (position and direction) and goal start at distinct
    random free cells, including gaps. Everything is drawn again for each episode.

    ## Mission Space

    "walk through the gaps to the green goal"

    ## Action Space

    | Num | Name    | Action                                    |
    |-----|---------|-------------------------------------------|
    | 0   | left    | Turn left                                 |
    | 1   | right   | Turn right                                |
    | 2   | forward | Move to the cell in front, if it is free  |
    | 3   | pickup  | No effect here                            |
    | 4   | drop    | No effect here                            |
    | 5   | toggle  | No effect here                            |
    | 6   | done    | No effect                                 |

    ## Observation Encoding

    `Box(0, 255, (S, S, 3), uint8)`: the whole grid, indexed by row y, then column x. A cell holds
    (type, colour, state): empty (1, 0, 0), wall (2, 5, 0), goal (8, 1, 0); the agent's cell holds
    (10, 0, direction) with 0 = right, 1 = down, 2 = left, 3 = up. It is the image of Minigrid's `FullyObsWrapper`
    with its first two axes swapped.

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

    - `SPRL/FourRooms-7x7-v1`
    - `SPRL/FourRooms-11x11-v1`

    ## Version history

    - v1: first version.
    """  # noqa: D212, D415 - the sections have Minigrid's form

    @staticmethod
    def _mission() -> str:
        return "walk through the gaps to the green goal"

    def _gen_grid(self, width: int, height: int) -> None:
        layout = four_rooms_layout(width, self.np_random.random(FOUR_ROOMS_DRAWS).tolist())
        middle = width // 2
        self.grid = Grid(width, height)
        self.grid.wall_rect(0, 0, width, height)
        self.grid.vert_wall(middle, 0)
        self.grid.horz_wall(0, middle)
        for gap in (
            (middle, layout.gap_up),
            (middle, layout.gap_down),
            (layout.gap_left, middle),
            (layout.gap_right, middle),
        ):
            self.grid.set(*gap, None)
        self.put_obj(Goal(), layout.goal_x, layout.goal_y)
        self.agent_pos, self.agent_dir = (layout.agent_x, layout.agent_y), layout.direction


class FourRooms7x7(FourRooms):
    """FourRooms with S = 7."""

    size: ClassVar[int] = 7


class FourRooms11x11(FourRooms):
    """FourRooms with S = 11."""

    size: ClassVar[int] = 11
