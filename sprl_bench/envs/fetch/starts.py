"""The random start of an episode: object and goal positions, in the order of Gymnasium-Robotics' draws."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Point = NDArray[np.float64]


@dataclass(frozen=True)
class Starts:
    """The distribution of the starts of one task.

    Attributes:
        gripper: Initial position of the gripper, [3] in metres.
        has_object: Whether the task has an object.
        object_range: Half the side of the square of object positions around the gripper.
        target_range: Half the side of the cube of goals around the gripper.
        target_offset: Added to the goals of tasks with an object, a number or [3].
        in_the_air: Whether a goal of a task with an object may be above the table.
        height: The height of a goal on the table (tasks with an object only).
    """

    gripper: Point
    has_object: bool
    object_range: float
    target_range: float
    target_offset: Any
    in_the_air: bool
    height: float

    @classmethod
    def of(cls, simulation: Any) -> Starts:
        """Return the starts of a settled simulation."""
        return cls(
            gripper=simulation.initial_gripper_xpos.copy(),
            has_object=simulation.has_object,
            object_range=simulation.obj_range,
            target_range=simulation.target_range,
            target_offset=simulation.target_offset,
            in_the_air=simulation.target_in_the_air,
            height=float(simulation.height_offset) if simulation.has_object else 0.0,
        )

    def draw(self, generator: np.random.Generator) -> tuple[Point, Point]:
        """Return the position of the object on the table, [2] ([0] without an object), and the goal, [3]."""
        if not self.has_object:
            return np.empty(0), self._point(generator)
        place = self._place(generator)
        goal = self._point(generator) + self.target_offset
        goal[2] = self.height
        if self.in_the_air and generator.uniform() < 0.5:
            goal[2] += generator.uniform(0, 0.45)
        return place, goal

    def _point(self, generator: np.random.Generator) -> Point:
        return self.gripper + generator.uniform(-self.target_range, self.target_range, size=3)

    def _place(self, generator: np.random.Generator) -> Point:
        """Draw until the object is at least 10 cm from the gripper."""
        place = self.gripper[:2]
        while np.linalg.norm(place - self.gripper[:2]) < 0.1:
            place = self.gripper[:2] + generator.uniform(-self.object_range, self.object_range, size=2)
        return place
