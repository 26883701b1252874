"""The spring of a gear train."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from qsframework.plugin import Actuator, Parameter, RobotFacts, Spring, place


@dataclass(frozen=True)
class JointCompliance(Spring):
    """A gear twists in proportion to the torque that it carries."""

    joint: str = place()
    role = "gear"
    equation = "eps = c tau, tau = J' w  (1)-(4)"
    source = "Klimchik et al., virtual joint modelling, equations (1)-(4)"
    check = "Gear wear, belt tension, motor mounting of this joint."

    def parameters(self, robot: RobotFacts) -> tuple[Parameter, ...]:
        return (Parameter(self.name, "rad/(N m)", nominal=0.0, typical=robot.sizes.compliance(20e-3), lower=0.0),)

    def virtual_joints(self, robot: RobotFacts) -> tuple[Actuator, ...]:
        return (Actuator(self.joint),)

    def validate(self, robot: RobotFacts) -> None:
        robot.joint_index(self.joint)

    @classmethod
    def places(cls, robot: RobotFacts, markers: Sequence[str] = ()) -> tuple[JointCompliance, ...]:
        return tuple(cls(joint) for joint in robot.driven)
