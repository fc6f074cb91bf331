"""A fix of Gymnasium-Robotics for MuJoCo 3.12 and later, used only by our environments.

Four functions of its `mujoco_utils` (get and set of a joint's position and velocity) assert that a joint's type, a
NumPy integer, is in a tuple of `mjtJoint` members. Since MuJoCo 3.12, `integer == member` is False, so the assertion
fails for every hinge and slide. `joint_utils` returns a private copy of the module in which the members are integers,
or the module itself if it works. The original module is never changed.
"""

from __future__ import annotations

import functools
import importlib.util
from enum import IntEnum
from types import ModuleType
from typing import Any

import mujoco
from gymnasium_robotics.utils import mujoco_utils

_ONE_HINGE = "<mujoco><worldbody><body><joint name='hinge'/><geom size='1'/></body></worldbody></mujoco>"


def is_broken(utils: ModuleType = mujoco_utils) -> bool:
    """Return whether `utils` fails to read the position of a hinge."""
    model = mujoco.MjModel.from_xml_string(_ONE_HINGE)
    try:
        utils.get_joint_qpos(model, mujoco.MjData(model), "hinge")
    except AssertionError:
        return True
    return False


@functools.cache
def joint_utils() -> ModuleType:
    """Return Gymnasium-Robotics' `mujoco_utils`, or a fixed private copy if it is broken."""
    original: ModuleType = mujoco_utils
    if not is_broken():
        return original
    spec = original.__spec__
    assert spec is not None
    assert spec.loader is not None
    copy = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(copy)
    copy.mujoco = _IntegerJoints()  # type: ignore[attr-defined]  # the global that its functions use
    return copy


class _IntegerJoints:
    """The `mujoco` module, with joint types that equal NumPy integers on either side."""

    mjtJoint = IntEnum(  # type: ignore[misc]  # mypy needs literal members
        "mjtJoint", {name: int(member) for name, member in mujoco.mjtJoint.__members__.items()}
    )

    def __getattr__(self, name: str) -> Any:
        return getattr(mujoco, name)
