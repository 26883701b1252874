"""The ratio of a gear is not the one that the controller has."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from qsframework.plugin import Array, Context, Geometry, GeometryTerm, Parameter, RobotFacts, place


@dataclass(frozen=True)
class GearRatio(Geometry):
    """A joint turns, or slides, by a share more than the controller thinks, from its zero on."""

    joint: str = place()
    slides = True
    equation = "q = (1 + k) q_0"
    source = "belts and friction drives: parts in a thousand; a wrong entry for a gear: much more"
    check = "Ratio of this joint in the controller; slip and stretch of its belt."

    def parameters(self, robot: RobotFacts) -> tuple[Parameter, ...]:
        return (Parameter(self.name, "", typical=5e-4, nominal_sd=5e-4),)

    def validate(self, robot: RobotFacts) -> None:
        robot.joint_index(self.joint)

    def errors(self, x: Array, context: Context) -> GeometryTerm:
        k, q = context.robot.joint_index(self.joint), context.poses.q
        slope = np.zeros((*q.shape, 1))
        slope[:, k, 0] = q[:, k]
        return GeometryTerm(slope @ x, slope)

    @classmethod
    def places(cls, robot: RobotFacts, markers: Sequence[str] = ()) -> tuple[GearRatio, ...]:
        return tuple(cls(joint) for joint in robot.driven)
