"""An encoder's disc turns off its centre."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from qsframework.plugin import Array, Geometry, GeometryTerm, Parameter, Poses, RobotFacts, place


@dataclass(frozen=True)
class EncoderEccentricity(Geometry):
    """A joint's true angle differs by a sin q + b cos q from what the controller thinks."""

    joint: str = place()
    source = "eccentricity of encoders and gears: once per turn, 10 to 50 urad"
    check = "Encoder and gear of this joint."

    def parameters(self, robot: RobotFacts) -> tuple[Parameter, ...]:
        return tuple(Parameter(f"{self.name}.{wave}", "rad", typical=5e-5) for wave in ("sin", "cos"))

    def validate(self, robot: RobotFacts) -> None:
        robot.joint_index(self.joint)

    def errors(self, poses: Poses, x: Array, robot: RobotFacts) -> GeometryTerm:
        k = robot.joint_index(self.joint)
        slope = np.zeros((*poses.q.shape, 2))
        slope[:, k, 0], slope[:, k, 1] = np.sin(poses.q[:, k]), np.cos(poses.q[:, k])
        return GeometryTerm(slope @ x, slope)

    @classmethod
    def places(cls, robot: RobotFacts, markers: Sequence[str] = ()) -> tuple[EncoderEccentricity, ...]:
        return tuple(cls(joint) for joint in robot.joints)
