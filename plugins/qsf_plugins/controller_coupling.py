"""The controller's angle convention is not the one that the model assumes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from qsframework.plugin import Array, Context, Geometry, GeometryTerm, InputError, Parameter, RobotFacts, place


@dataclass(frozen=True)
class ControllerCoupling(Geometry):
    """A joint's true angle holds a share of the angle that the pendant shows for the joint before it.

    -1 or +1 stands for a wrong reading of an absolute as a relative angle, or the reverse.
    """

    joint: str = place()
    slides = True
    role = "shown angle"
    equation = "q_j = pendant_j + k pendant_(j-1)"
    source = "FANUC operator's manual B-83444EN/01: J3 is shown as the forearm's elevation"
    check = "How the controller shows this joint: move the joint before it alone and watch."

    def parameters(self, robot: RobotFacts) -> tuple[Parameter, ...]:
        return (Parameter(self.name, "", nominal=0.0, typical=1.0),)

    def validate(self, robot: RobotFacts) -> None:
        if robot.joint_index(self.joint) == 0 or self.joint in robot.passive:
            raise InputError(f"{self.name}: the joint must have an angle on the pendant, and one before it")
        before = robot.driven[robot.driven.index(self.joint) - 1]
        if robot.slides(self.joint) != robot.slides(before):
            raise InputError(f"{self.name}: of {before} and {self.joint} one slides and the other turns")

    def errors(self, x: Array, context: Context) -> GeometryTerm:
        robot, poses = context.robot, context.poses
        slope = np.zeros((*poses.q.shape, 1))
        slope[:, robot.joint_index(self.joint), 0] = poses.pendant[:, robot.driven.index(self.joint) - 1]
        return GeometryTerm(slope @ x, slope)

    @classmethod
    def places(cls, robot: RobotFacts, markers: Sequence[str] = ()) -> tuple[ControllerCoupling, ...]:
        pairs = pairwise(robot.driven)
        return tuple(cls(joint) for before, joint in pairs if robot.slides(joint) == robot.slides(before))
