"""The spring of a gear train, or of what drives a slide."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from qsframework.plugin import Actuator, Parameter, RobotFacts, Spring, place


@dataclass(frozen=True)
class JointCompliance(Spring):
    """A gear twists in proportion to the torque that it carries, a slide's drive gives in proportion to the force."""

    joint: str = place()
    slides = True
    role = "gear"
    equation = "eps = c tau, tau = J' w  (1)-(4)"
    source = "Klimchik et al., virtual joint modelling, equations (1)-(4)"
    check = "Gear wear, belt tension, motor mounting of this joint."

    def parameters(self, robot: RobotFacts) -> tuple[Parameter, ...]:
        unit = robot.unit_of(self.joint)
        size = robot.sizes.compliance_of(unit, 1e-3 if robot.slides(self.joint) else 20e-3)
        return (Parameter(self.name, unit.give, nominal=0.0, typical=size, lower=0.0),)

    def virtual_joints(self, robot: RobotFacts) -> tuple[Actuator, ...]:
        return (Actuator(self.joint),)

    def validate(self, robot: RobotFacts) -> None:
        robot.joint_index(self.joint)

    @classmethod
    def places(cls, robot: RobotFacts, markers: Sequence[str] = ()) -> tuple[JointCompliance, ...]:
        return tuple(cls(joint) for joint in robot.driven)
