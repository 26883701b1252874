"""What the arm is: files, kinematics, controller convention."""

from qsframework.robot.alternatives import Alternative, StructuralChange, alternatives
from qsframework.robot.controller import Controller, Drive
from qsframework.robot.loader import load_robot, robot_names
from qsframework.robot.robot import LinkFrame, Robot, Shape

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
