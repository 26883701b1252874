"""What the arm is: files, kinematics, controller convention."""

from typing import TYPE_CHECKING

from qsframework.lazily import lazily

if TYPE_CHECKING:
    from qsframework.robot.alternatives import Alternative, StructuralChange, alternatives
    from qsframework.robot.controller import Controller, Drive
    from qsframework.robot.loader import load_robot
    from qsframework.robot.robot import LinkFrame, Robot, Shape
    from qsframework.robot.search import robot_names

__all__ = [
    "Alternative",
    "Controller",
    "Drive",
    "LinkFrame",
    "Robot",
    "Shape",
    "StructuralChange",
    "alternatives",
    "load_robot",
    "robot_names",
]
__getattr__ = lazily(
    __name__,
    {
        "alternatives": "Alternative StructuralChange alternatives",
        "controller": "Controller Drive",
        "loader": "load_robot",
        "robot": "LinkFrame Robot Shape",
        "search": "robot_names",
    },
)
