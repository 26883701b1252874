"""A joint is not quite where the drawing says."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from qsframework.plugin import Array, Context, Geometry, GeometryTerm, Parameter, RobotFacts, place


@dataclass(frozen=True)
class JointPlacement(Geometry):
    """A joint's frame is shifted (x, y, z) and turned (rx, ry, rz) against the previous link."""

    joint: str = place()
    slides = True
    role = "joint placement"
    moves_placements = True
    equation = "frame = nominal frame moved by (x, y, z), turned by the rotation vector (rx, ry, rz)"
    source = "geometric calibration of arms: tenths of a millimetre and of a milliradian"
    check = "Nothing on the robot; correct the model."

    def parameters(self, robot: RobotFacts) -> tuple[Parameter, ...]:
        sizes = [(axis, "m", 5e-4) for axis in "xyz"] + [(f"r{axis}", "rad", 5e-4) for axis in "xyz"]
        return tuple(Parameter(f"{self.name}.{n}", unit, typical=sd, nominal_sd=sd) for n, unit, sd in sizes)

    def validate(self, robot: RobotFacts) -> None:
        robot.joint_index(self.joint)

    def errors(self, x: Array, context: Context) -> GeometryTerm:
        batch, n = context.poses.q.shape
        slope = np.zeros((n, 6, 6))  # the same at every pose: views of one block cost nothing
        slope[context.robot.joint_index(self.joint)] = np.eye(6)
        twists, twists_dx = np.broadcast_to(slope @ x, (batch, n, 6)), np.broadcast_to(slope, (batch, n, 6, 6))
        return GeometryTerm(twists=twists, twists_dx=twists_dx)

    @classmethod
    def places(cls, robot: RobotFacts, markers: Sequence[str] = ()) -> tuple[JointPlacement, ...]:
        return tuple(cls(joint) for joint in robot.joints)
