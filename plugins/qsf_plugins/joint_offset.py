"""The zero of an encoder."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from qsframework.plugin import Array, Context, Geometry, GeometryTerm, Parameter, RobotFacts, place


@dataclass(frozen=True)
class JointOffset(Geometry):
    """An actuator stands at a constant angle, or travel, from the controller's value."""

    joint: str = place()
    slides = True
    role = "joint zero"
    equation = "q = q_0 + offset"
    source = "encoder zero after mastering: 10 to 50 urad; after a collision more"
    check = "Mastering marks of this joint."

    def parameters(self, robot: RobotFacts) -> tuple[Parameter, ...]:
        return (Parameter(self.name, robot.unit_of(self.joint).si, typical=1e-3, nominal_sd=1e-3),)

    def validate(self, robot: RobotFacts) -> None:
        robot.joint_index(self.joint)

    def errors(self, x: Array, context: Context) -> GeometryTerm:
        slope = np.zeros((*context.poses.q.shape, 1))
        slope[:, context.robot.joint_index(self.joint), 0] = 1.0
        return GeometryTerm(slope @ x, slope)

    @classmethod
    def places(cls, robot: RobotFacts, markers: Sequence[str] = ()) -> tuple[JointOffset, ...]:
        return tuple(cls(joint) for joint in robot.driven)
